"""Blobs as files: what stands for a store where values are made from bytes, without reading large ones whole."""

from __future__ import annotations

from pathlib import Path

from dextera_build.store.cas import Blobs, MissingBlob
from dextera_build.store.materialize import place


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
        """Write a blob to a file of one's own; see `materialize.place`."""
        place(self._blobs, digest, target)


class Writer:
    """bytes -> digest, or a file that is stored in pieces.

    Args:
        blobs: The blobs of a store.
    """

    def __init__(self, blobs: Blobs) -> None:
        self._blobs = blobs

    def __call__(self, data: bytes) -> str:
        """Store bytes; see `Blobs.put`."""
        return self._blobs.put(data)

    def file(self, path: Path) -> tuple[str, int]:
        """Store the bytes of a file: (digest, size); see `Blobs.put_file`."""
        return self._blobs.put_file(path)

    def has(self, digest: str, size: int) -> bool:
        """Whether this blob is stored and stays while the build runs."""
        return self._blobs.holds(digest, size)
