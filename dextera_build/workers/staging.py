"""Moves artifacts between a store and the remote shared by a cluster; tasks themselves carry only digests."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from dextera_build.errors import MachineError
from dextera_build.remotes.remote import Digest, Remote, RemoteFault
from dextera_build.remotes.threads import Crew
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store

_AT_ONCE = 16


class Staging:
    """Transfers between one machine's store and the shared remote.

    Args:
        store: The machine's store.
        shared: The remote.
    """

    def __init__(self, store: Store, shared: Remote) -> None:
        self._blobs, self._references = store.blobs, store.actions.references
        self._shared = shared
        self._crew = Crew(_AT_ONCE, "dxb blobs")
        self._there: set[str] = set()
        """Artifacts that the remote is known to hold, including everything they reference."""

    def send(self, artifacts: Iterable[str], blobs: Iterable[str] = ()) -> None:
        """Upload artifacts with everything they reference, and single blobs.

        Raises:
            MissingBlob: The store lacks one.
            MachineError: The remote is unreachable or refuses.
        """
        fresh = [artifact for artifact in artifacts if artifact not in self._there]
        below = (digest for artifact in fresh for digest in (*self._references.below(artifact), artifact))
        wanted = [self._sized(digest) for digest in dict.fromkeys((*blobs, *below))]
        with _faults_told():
            self._crew.each(self._send, wanted)
        self._there.update(fresh)

    def bring(self, artifacts: Iterable[str], blobs: Iterable[str] = ()) -> None:
        """Download artifacts with everything they reference, and single blobs.

        Raises:
            MissingBlob: The remote lacks one.
            MachineError: The remote cannot be reached.
            StoreError: The disk is full.
        """
        level = list(artifacts)
        self._fetch([*level, *blobs])
        seen = set[str]()
        while level:
            seen.update(level)
            direct = [self._references.directly(artifact) for artifact in level]
            level = [ref for ref in dict.fromkeys(ref for refs, _ in direct for ref in refs) if ref not in seen]
            self._fetch([*level, *(blob for _, found in direct for blob in found)])
        self._there.update(seen)

    def send_made(self, reply: Mapping[str, Any]) -> None:
        """Upload the output of a call; raises as `send`."""
        self.send([reply["output"], *self._answers(reply)], _named(reply))

    def bring_made(self, reply: Mapping[str, Any]) -> None:
        """Download the output of a call; raises as `bring`."""
        self.bring([reply["output"]], _named(reply))
        self.bring(self._answers(reply))

    def _answers(self, reply: Mapping[str, Any]) -> list[str]:
        """The artifacts that hold the answers of recorded calls."""
        results = [self._blobs.get(call["result"]) for call in reply.get("calls", ())]
        return [ActionResult.from_document(result).output for result in results]

    def _fetch(self, digests: Iterable[str]) -> None:
        lacking = [digest for digest in dict.fromkeys(digests) if not self._holds(digest)]

        def bring(digest: str) -> None:
            self._shared.fetch(Digest(digest, 0), lambda pieces: self._blobs.receive(digest, None, pieces))

        with _faults_told():
            self._crew.each(bring, lacking)
        for digest in lacking:
            if not self._blobs.has(digest):
                raise MissingBlob(digest, f"the remote `{self._shared.address}` does not hold it")

    def _holds(self, digest: str) -> bool:
        size = self._blobs.size(digest)
        return size is not None and self._blobs.holds(digest, size)

    def _sized(self, digest: str) -> Digest:
        size = self._blobs.size(digest)
        if size is None:
            raise MissingBlob(digest)
        return Digest(digest, size)

    def _send(self, digest: Digest) -> None:
        if not self._shared.has(digest):
            with self._blobs.checked(digest.hash) as file:
                self._shared.send(digest, file)


@contextmanager
def _faults_told() -> Iterator[None]:
    """Convert a fault of the shared remote to the error of the node that needs it."""
    try:
        yield
    except RemoteFault as fault:
        raise MachineError(
            f"the remote that the cluster shares does not work: {fault.reason}",
            code="DXB-E355",
            facts={"remote": fault.address},
            hint="every machine of the cluster must be able to read and write it under this address",
        ) from None


def _named(reply: Mapping[str, Any]) -> list[str]:
    """Blobs that a reply references directly: previews, recorded calls and their results."""
    calls = [digest for call in reply.get("calls", ()) for digest in (call["call"], call["result"])]
    return [*calls, *(blob for _, blob in reply.get("previews", ()))]
