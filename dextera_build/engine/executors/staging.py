"""Between the store of a cluster's node and the store of the driver: what a call reads comes, what it made goes.

Both are asked for by digest over HTTP, and what comes is compared with its digest before it shows.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, BinaryIO, TypeVar

from dextera_build.errors import MachineError, StoreError
from dextera_build.store import header
from dextera_build.store.cas import MissingBlob
from dextera_build.store.entry import ActionResult
from dextera_build.store.remotes.remote import Digest, Remote, RemoteFault
from dextera_build.store.store import Store

T = TypeVar("T")

_SMALL = 1 << 16
"""Blobs up to this size [bytes] are sent without asking whether they are there."""
_RESTS_S = (0.2, 1.0, 3.0)
_MOST_KNOWN = 1 << 17


class Staging:
    """Keeps one node's store supplied.

    Args:
        store: The node's.
        driver: The driver's store, as a remote.
    """

    def __init__(self, store: Store, driver: Remote) -> None:
        self._store = store
        self._driver = driver
        self._there: set[str] = set()
        """Blobs that the driver is known to hold."""

    def pull(self, artifacts: Iterable[str]) -> None:
        """Have artifacts, with all that they refer to, in the node's store.

        Raises:
            MissingBlob: The driver lacks one.
            MachineError: The driver cannot be reached.
            StoreError: The node's disk is full.
        """
        level, seen = list(dict.fromkeys(artifacts)), set[str]()
        while level:
            seen.update(level)
            self.bring(level)
            direct = [header.closure(self._store.blobs.get(artifact)) for artifact in level]
            self.bring(blob for _, blobs in direct for blob in blobs)
            level = [ref for ref in dict.fromkeys(ref for refs, _ in direct for ref in refs) if ref not in seen]

    def bring(self, digests: Iterable[str]) -> None:
        """Have blobs in the node's store; raises as `pull`."""
        lacking = [digest for digest in dict.fromkeys(digests) if not self._holds(digest)]
        troubles: list[StoreError] = []

        def take(wanted: Digest, pieces: Iterator[bytes]) -> None:
            try:
                if not troubles:
                    self._store.blobs.receive(wanted.hash, None, pieces)
            except StoreError as error:
                troubles.append(error)

        if lacking:
            self._patiently(lambda: self._driver.fetch([Digest(digest, 0) for digest in lacking], take))
        if troubles:
            raise troubles[0]
        for digest in lacking:
            if not self._store.blobs.has(digest):
                raise MissingBlob(digest, "the driver does not hold it")
        self._know(lacking)

    def push(self, reply: Mapping[str, Any]) -> None:
        """Give the driver all that a call made.

        Args:
            reply: What the runner returned.

        Raises:
            MissingBlob: The node's store lost something meanwhile.
            MachineError: The driver cannot be reached, or has no room.
        """
        wanted = [
            Digest(digest, self._size(digest))
            for digest in dict.fromkeys(self._made(reply))
            if digest not in self._there
        ]
        large = [digest for digest in wanted if digest.size > _SMALL]
        held = set(large) - self._patiently(lambda: self._driver.missing(large)) if large else set()
        lacking = [digest for digest in wanted if digest not in held]
        if lacking:
            self._patiently(lambda: self._driver.send(lacking, self._open))
        self._know(digest.hash for digest in wanted)

    def _made(self, reply: Mapping[str, Any]) -> Iterator[str]:
        yield from self._whole(reply["output"])
        yield from (blob for _, blob in reply.get("previews") or ())
        for call in reply.get("calls") or ():
            yield from (call["call"], call["result"])
            yield from self._whole(ActionResult.from_document(self._store.blobs.get(call["result"])).output)

    def _whole(self, artifact: str) -> Iterator[str]:
        """An artifact and all that it refers to; what the driver holds is not looked into."""
        stack, seen = [artifact], set[str]()
        while stack:
            here = stack.pop()
            if here in seen or here in self._there:
                continue
            seen.add(here)
            refs, blobs = header.closure(self._store.blobs.get(here))
            yield from (*blobs, here)
            stack += refs

    def _holds(self, digest: str) -> bool:
        size = self._store.blobs.size(digest)
        return size is not None and self._store.blobs.holds(digest, size)

    def _size(self, digest: str) -> int:
        size = self._store.blobs.size(digest)
        if size is None:
            raise MissingBlob(digest)
        return size

    def _open(self, digest: Digest) -> BinaryIO:
        try:
            return open(self._store.blobs.path(digest.hash), "rb")
        except OSError:
            raise MissingBlob(digest.hash) from None

    def _know(self, digests: Iterable[str]) -> None:
        if len(self._there) > _MOST_KNOWN:
            self._there.clear()
        self._there.update(digests)

    def _patiently(self, ask: Callable[[], T]) -> T:
        for rest_s in (*_RESTS_S, None):
            try:
                return ask()
            except RemoteFault as fault:
                if rest_s is None or fault.refused:
                    raise MachineError(
                        f"a worker cannot reach the store of the driver: {fault.reason}",
                        code="DXB-E355",
                        facts={"driver": fault.address},
                        hint="every node of the cluster must reach the machine where `dxb build` runs, on any port",
                    ) from None
                time.sleep(rest_s)
        raise AssertionError
