"""A file without a name, in which lies what a build needs later and need not hold in memory."""

from __future__ import annotations

import os
from collections.abc import Collection
from typing import BinaryIO

from dextera_build.store import files


class Aside:
    """Pieces, one behind the other; they are gone with the process."""

    def __init__(self) -> None:
        self._made: BinaryIO | None = None

    def add(self, pieces: Collection[bytes | bytearray]) -> int:
        """Lay pieces behind all others; returns where the first begins.

        Raises:
            OSError: There is no room for them, or nowhere to make a file.
        """
        file = self._file()
        place = file.seek(0, os.SEEK_END)
        files.write_all(file.fileno(), b"".join(pieces))
        return place

    def read(self, place: int, size: int) -> bytes:
        """So many bytes from a place."""
        return os.pread(self._file().fileno(), size, place)

    def _file(self) -> BinaryIO:
        if self._made is None:
            from tempfile import TemporaryFile

            self._made = TemporaryFile(buffering=0)  # noqa: SIM115 - as long as the build
        return self._made
