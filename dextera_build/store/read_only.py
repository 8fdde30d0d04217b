"""Blobs of a store that a command only reads, where it could not write: a plan needs digests and a few headers."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path

from dextera_build import digest as digests
from dextera_build.store.blobs import Blobs


class Aside(Blobs):
    """Blobs that are read where they lie; what is put stays in memory, and of files no more than digest and size.

    Args:
        root: The folder, there or not; it is not made.
    """

    def __init__(self, root: Path) -> None:
        super().__init__(root)
        self._held: dict[str, bytes] = {}
        self._sizes: dict[str, int] = {}

    def size(self, digest: str) -> int | None:
        """Size of the blob [bytes], or None where there is none."""
        known = self._sizes.get(digest)
        return known if known is not None else super().size(digest)

    def holds(self, digest: str, size: int, check: Callable[[], bool] | None = None) -> bool:
        """Whether the blob is there with this size; see `Blobs.holds`."""
        return self._sizes.get(digest) == size or super().holds(digest, size, check)

    def put(self, data: bytes) -> str:
        """Hold `data` in memory and return its digest."""
        digest = hashlib.sha256(data).hexdigest()
        self._held[digest], self._sizes[digest] = data, len(data)
        return digest

    def put_file(self, path: Path) -> tuple[str, int]:
        """(digest, size) of a file.

        Raises:
            OSError: `path` cannot be read.
        """
        digest, size = digests.of_file(path), os.stat(path).st_size
        self._sizes[digest] = size
        return digest, size

    def get(self, digest: str) -> bytes:
        """The bytes of a blob; see `Blobs.get`."""
        held = self._held.get(digest)
        return held if held is not None else super().get(digest)
