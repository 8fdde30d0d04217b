"""A store as artifacts see it: bytes or files by digest, and digests of bytes or files."""

from __future__ import annotations

from pathlib import Path

from dextera_build.store.blobs import Blobs, MissingBlob


class Reader:
    """digest -> bytes, or a file with them.

    Args:
        blobs: The blobs of a store.
    """

    def __init__(self, blobs: Blobs) -> None:
        self._blobs = blobs

    def __call__(self, digest: str) -> bytes:
        """The bytes of a blob; see `Blobs.get`."""
        return self._blobs.get(digest)

    def path(self, digest: str) -> Path:
        """The file of a blob whose bytes were compared with its digest; it may only be read.

        Raises:
            MissingBlob: It is not there, or its bytes are not what they were; then it was set aside.
        """
        if not self._blobs.verify(digest):
            raise MissingBlob(digest)
        return self._blobs.path(digest)

    def place(self, digest: str, target: Path) -> None:
        """Write a blob to a file of the caller's own; see `Blobs.place`."""
        self._blobs.place(digest, target)


class Writer:
    """bytes -> digest, or a file that is stored in pieces.

    Args:
        blobs: The blobs of a store.
    """

    def __init__(self, blobs: Blobs) -> None:
        self._blobs = blobs
        self.sizes: dict[str, int] = {}
        """What was stored, or was there: digest -> size [bytes]."""

    def __call__(self, data: bytes) -> str:
        """Store bytes; see `Blobs.put`."""
        digest = self._blobs.put(data)
        self.sizes[digest] = len(data)
        return digest

    def file(self, path: Path) -> tuple[str, int]:
        """Store the bytes of a file: (digest, size); see `Blobs.put_file`."""
        digest, size = self._blobs.put_file(path)
        self.sizes[digest] = size
        return digest, size

    def has(self, digest: str, size: int) -> bool:
        """Whether this blob is stored and stays while the build runs."""
        there = self._blobs.holds(digest, size)
        if there:
            self.sizes[digest] = size
        return there
