"""Blobs as files: what stands for a store where values are made from bytes, without reading large ones whole."""

from __future__ import annotations

from collections import OrderedDict
from pathlib import Path

from dextera_build.store.blobs import Blobs, MissingBlob
from dextera_build.store.materialize import place

_SMALL = 1 << 14
_MOST_KNOWN = 1 << 10


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


class Recent(Reader):
    """Reads blobs, and keeps small ones that came by last: neighbours in a graph read the same, and what others wrote.

    Args:
        blobs: The blobs of a store.
    """

    def __init__(self, blobs: Blobs) -> None:
        super().__init__(blobs)
        self._known: OrderedDict[str, bytes] = OrderedDict()

    def __call__(self, digest: str) -> bytes:
        """The bytes of a blob; see `Blobs.get`."""
        data = self._known.get(digest)
        if data is None:
            data = super().__call__(digest)
            self.keep(digest, data)
        return data

    def known(self, digest: str) -> bytes | None:
        """The bytes of a blob that came by of late, which need not be there any more, or None."""
        return self._known.get(digest)

    def keep(self, digest: str, data: bytes) -> None:
        """Note the bytes of a blob."""
        if len(data) <= _SMALL:
            self._known[digest] = data
            if len(self._known) > _MOST_KNOWN:
                self._known.popitem(last=False)


class Writer:
    """bytes -> digest, or a file that is stored in pieces.

    Args:
        blobs: The blobs of a store.
        recent: Told of what is written.
    """

    def __init__(self, blobs: Blobs, recent: Recent | None = None) -> None:
        self._blobs = blobs
        self._recent = recent
        self.sizes: dict[str, int] = {}
        """What was stored, or was there: digest -> size [bytes]."""

    def __call__(self, data: bytes) -> str:
        """Store bytes; see `Blobs.put`."""
        digest = self._blobs.put(data)
        self.sizes[digest] = len(data)
        if self._recent is not None:
            self._recent.keep(digest, data)
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
