"""Artifacts between a store and the remote that all machines of a cluster share; only digests travel otherwise."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from io import BytesIO
from typing import Any, BinaryIO, TypeVar

from dextera_build.errors import MachineError, StoreError
from dextera_build.remotes.remote import Digest, Remote, RemoteFault
from dextera_build.store.backoff import backoff
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store

T = TypeVar("T")

_TRIES = 4
_WAIT_S = 0.5
"""Before the second try of a remote that does not answer [s]."""


class Staging:
    """One machine's way to the shared remote.

    Args:
        store: The machine's.
        shared: The remote.
    """

    def __init__(self, store: Store, shared: Remote) -> None:
        self._store = store
        self._shared = shared
        self._there: set[str] = set()
        """Artifacts that the remote is known to hold, with everything below them."""

    def send(self, artifacts: Iterable[str], blobs: Iterable[str] = ()) -> None:
        """Upload artifacts with everything that they refer to, and single blobs.

        Raises:
            MissingBlob: The store lacks one.
            MachineError: The remote cannot be reached, or refuses.
        """
        fresh = [artifact for artifact in dict.fromkeys(artifacts) if artifact not in self._there]
        below = (digest for artifact in fresh for digest in (*self._store.actions.references.below(artifact), artifact))
        wanted = [Digest(digest, self._size(digest)) for digest in dict.fromkeys((*blobs, *below))]
        if wanted and (lacking := self._patiently(lambda: self._shared.missing(wanted))):
            self._patiently(lambda: self._shared.send(sorted(lacking), self._open))
        self._there.update(fresh)

    def bring(self, artifacts: Iterable[str], blobs: Iterable[str] = ()) -> None:
        """Download artifacts with everything that they refer to, and single blobs.

        Raises:
            MissingBlob: The remote lacks one.
            MachineError: The remote cannot be reached.
            StoreError: The disk is full.
        """
        self._fetch(blobs)
        level = wanted = list(dict.fromkeys(artifacts))
        seen = set[str]()
        while level:
            seen.update(level)
            self._fetch(level)
            direct = [self._store.actions.references.directly(artifact) for artifact in level]
            self._fetch(blob for _, found in direct for blob in found)
            level = [ref for ref in dict.fromkeys(ref for refs, _ in direct for ref in refs) if ref not in seen]
        self._there.update(wanted)

    def send_made(self, reply: Mapping[str, Any]) -> None:
        """Upload what a call made; raises as `send`."""
        self.send([reply["output"], *self._answers(reply)], _blobs(reply))

    def bring_made(self, reply: Mapping[str, Any]) -> None:
        """Download what a call made; raises as `bring`."""
        self._fetch(_blobs(reply))
        self.bring([reply["output"], *self._answers(reply)])

    def _answers(self, reply: Mapping[str, Any]) -> Iterator[str]:
        """The artifacts that hold the answers of recorded calls."""
        for call in reply.get("calls") or ():
            yield ActionResult.from_document(self._store.blobs.get(call["result"])).output

    def _fetch(self, digests: Iterable[str]) -> None:
        lacking = [digest for digest in dict.fromkeys(digests) if not self._holds(digest)]
        troubles: list[StoreError] = []

        def take(wanted: Digest, pieces: Iterator[bytes]) -> None:
            try:
                if not troubles:
                    self._store.blobs.receive(wanted.hash, None, pieces)
            except StoreError as error:
                troubles.append(error)

        if lacking:
            self._patiently(lambda: self._shared.fetch([Digest(digest, 0) for digest in lacking], take))
        if troubles:
            raise troubles[0]
        for digest in lacking:
            if not self._store.blobs.has(digest):
                raise MissingBlob(digest, f"the remote `{self._shared.address}` does not hold it")

    def _holds(self, digest: str) -> bool:
        size = self._store.blobs.size(digest)
        return size is not None and self._store.blobs.holds(digest, size)

    def _size(self, digest: str) -> int:
        size = self._store.blobs.size(digest)
        if size is None:
            raise MissingBlob(digest)
        return size

    def _open(self, digest: Digest) -> BinaryIO:
        blobs = self._store.blobs
        return blobs.open(digest.hash) if blobs.verify(digest.hash) else BytesIO(blobs.get(digest.hash))

    def _patiently(self, ask: Callable[[], T]) -> T:
        for tries in range(1, _TRIES + 1):
            try:
                return ask()
            except RemoteFault as fault:
                if tries == _TRIES or fault.refused:
                    raise MachineError(
                        f"the remote that the cluster shares does not work: {fault.reason}",
                        code="DXB-E355",
                        facts={"remote": fault.address},
                        hint="every machine of the cluster must be able to read and write it under this address",
                    ) from None
                time.sleep(backoff(tries, _WAIT_S))
        raise AssertionError


def _blobs(reply: Mapping[str, Any]) -> list[str]:
    calls = reply.get("calls") or ()
    previews = [blob for _, blob in reply.get("previews") or ()]
    return [*previews, *(digest for call in calls for digest in (call["call"], call["result"]))]
