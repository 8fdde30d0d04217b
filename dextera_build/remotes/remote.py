"""The interface of a remote: results by key and blobs by digest, shared by several machines.

A remote is not trusted: bytes from it are checked against their digest. A remote that misbehaves makes a build slower,
never wrong, and never makes it fail.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from typing import BinaryIO, NamedTuple, Protocol

from dextera_build.redact import redact
from dextera_build.remotes.threads import Crew

MOST_ENTRY = 64 << 20
"""A result under a key that is longer is not taken [bytes]; one blob takes about 150 bytes there."""


class Digest(NamedTuple):
    """Names bytes."""

    hash: str
    """Lower-case hex SHA-256."""
    size: int
    """How many bytes."""


class RemoteFault(Exception):  # noqa: N818 - says what happened, as `MissingBlob` does
    """A remote did not do what it was asked: no connection, a time-out, an answer that makes no sense.

    Args:
        address: The remote.
        reason: What happened, for people; both are shown without secrets.
        refused: The remote works and said no (no right to, no such method): to ask again does not help.
    """

    def __init__(self, address: str, reason: str, *, refused: bool = False) -> None:
        self.address, self.reason = redact(address), redact(reason)
        super().__init__(f"{self.address}: {self.reason}")
        self.refused = refused


class DamagedBlob(RemoteFault):
    """A remote gave other bytes than those that it was asked for."""


class Remote(Protocol):
    """Two maps. Every method may be called from several threads, and raises `RemoteFault` and nothing else."""

    address: str
    """As the command line names it, without secrets."""

    def get_entry(self, key: str) -> bytes | None:
        """The entry under a key (the digest of the key document), or None; `entry.py` says how it is spelled.

        One that is longer than `MOST_ENTRY` is a `RemoteFault`, found before all of it is in memory.
        """
        ...

    def put_entry(self, key: str, message: bytes) -> None:
        """Publish a result, all of whose blobs the remote holds."""
        ...

    def missing(self, digests: Sequence[Digest]) -> set[Digest]:
        """Those that the remote lacks."""
        ...

    def fetch(self, digests: Sequence[Digest], take: Callable[[Digest, Iterator[bytes]], None]) -> None:
        """Hand `take` the bytes of every blob that the remote holds, in pieces; those that it lacks are left out.

        The remote chooses batches and parallel transfers; `take` may be called from several threads at once. `take`
        checks size and bytes, may stop before the last piece, and lets no error of its own out; a `RemoteFault` that
        the pieces raise passes through it.
        """
        ...

    def send(self, digests: Sequence[Digest], give: Callable[[Digest], BinaryIO]) -> None:
        """Upload blobs; `give` opens one, and the remote closes it."""
        ...

    def close(self) -> None:
        """Let connections go; calls that wait for an answer end with a `RemoteFault`."""
        ...


class SingleBlobs(ABC):
    """The half of a `Remote` that is about blobs, for remotes that know one blob at a time.

    Args:
        address: See `Remote`.
        threads: How many more than the calling one ask at once.
    """

    def __init__(self, address: str, threads: int) -> None:
        self.address = address
        self._crew = Crew(threads, f"dxb {address}")

    def missing(self, digests: Sequence[Digest]) -> set[Digest]:
        """Those that the remote lacks, or holds with another size."""
        lacking: set[Digest] = set()

        def look(digest: Digest) -> None:
            if not self._has(digest):
                lacking.add(digest)

        self._crew.each(look, digests)
        return lacking

    def fetch(self, digests: Sequence[Digest], take: Callable[[Digest, Iterator[bytes]], None]) -> None:
        """Hand `take` the bytes of every blob that the remote holds."""

        def fetch_one(digest: Digest) -> None:
            with self._reading(digest) as pieces:
                if pieces is not None:
                    take(digest, pieces)

        self._crew.each(fetch_one, digests)

    def send(self, digests: Sequence[Digest], give: Callable[[Digest], BinaryIO]) -> None:
        """Upload blobs."""

        def send_one(digest: Digest) -> None:
            with give(digest) as file:
                self._write(digest, file)

        self._crew.each(send_one, digests)

    def close(self) -> None:
        """Let the threads go."""
        self._crew.dismiss()

    @abstractmethod
    def _has(self, digest: Digest) -> bool:
        """Whether the remote holds a blob with this size."""

    @abstractmethod
    def _reading(self, digest: Digest) -> AbstractContextManager[Iterator[bytes] | None]:
        """The pieces of a blob, or None where the remote lacks it."""

    @abstractmethod
    def _write(self, digest: Digest, file: BinaryIO) -> None:
        """Upload one blob."""
