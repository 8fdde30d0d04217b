"""Tar archives that hold plain files and nothing else, by the `tarfile` of the standard library.

A header that announces anything but a file (a link, a device, a long name, an extended header) is refused before
`tarfile` acts on it.
"""

from __future__ import annotations

import io
import tarfile
from collections.abc import Iterator
from pathlib import Path
from typing import Self

from dextera_build.bundle.errors import archive, not_a_bundle, too_large

BLOCK = tarfile.BLOCKSIZE
END = bytes(2 * BLOCK)
MOST_FILES = 1 << 14
"""Files of one archive; `tarfile` keeps a record of each in memory."""
_CHUNK = 1 << 20


class _File(tarfile.TarInfo):
    """The header of a plain file."""

    kinds: tuple[bytes, ...] = (tarfile.REGTYPE, tarfile.AREGTYPE)

    @classmethod
    def frombuf(cls, buf: bytes | bytearray, encoding: str, errors: str) -> Self:
        found = super().frombuf(buf, encoding, errors)
        if found.type not in cls.kinds:
            raise archive(found.name[:200], "is neither a file nor a folder")
        if found.size < 0:
            raise archive(found.name[:200], "has a negative size")
        return found


class _FileOrFolder(_File):
    kinds = (*_File.kinds, tarfile.DIRTYPE)


def header(name: str, size: int) -> bytes:
    """The header of a file, without owner and time: equal files give equal archives."""
    info = tarfile.TarInfo(name)
    info.size, info.mode = size, 0o444
    return info.tobuf(tarfile.GNU_FORMAT, "ascii", "strict")


def padding(size: int) -> bytes:
    """What follows `size` bytes of content."""
    return bytes(-size % BLOCK)


def places(path: Path, most: int) -> Iterator[tuple[str, int, int]]:
    """Name, place and size of each file of an archive; folders are passed over.

    Raises:
        BundleRefused: It is no archive, is cut off, or holds something else, or more than `most` files.
    """
    total = path.stat().st_size
    try:
        packed = tarfile.open(path, "r:", tarinfo=_FileOrFolder, errors="strict")  # noqa: SIM115 - closed below
    except (tarfile.TarError, ValueError):
        raise not_a_bundle(str(path), "it is no tar archive") from None
    try:
        with packed:
            for number, info in enumerate(packed):
                if number >= most:
                    raise too_large("the list of files", number + 1, most)
                if info.offset_data + info.size > total:
                    raise archive(info.name[:200], "is cut off")
                if not info.isdir():
                    yield info.name, info.offset_data, info.size
    except (tarfile.TarError, ValueError, OverflowError) as error:
        raise archive("?", f"cannot be read ({error})") from None


def files(chunks: Iterator[bytes]) -> Iterator[tuple[str, int, Iterator[bytes]]]:
    """Name, size and content of each file of an archive that comes in pieces.

    Each content is to be read to its end before the next is asked for.

    Raises:
        BundleRefused: The archive ends too early, or holds something else.
    """
    try:
        with tarfile.open(fileobj=_Stream(chunks), mode="r|", tarinfo=_File) as packed:
            for number, info in enumerate(packed):
                if number >= MOST_FILES:
                    raise too_large("an archive", number + 1, MOST_FILES)
                yield info.name, info.size, _content(packed, info)
    except (tarfile.TarError, ValueError, OverflowError) as error:
        raise archive("?", f"cannot be read ({error})") from None
    for _ in chunks:  # `chunks` checks its digest after the last one
        pass


def _content(packed: tarfile.TarFile, info: tarfile.TarInfo) -> Iterator[bytes]:
    content = packed.extractfile(info)
    assert content is not None, "a plain file"
    try:
        while piece := content.read(_CHUNK):
            yield piece
    except tarfile.TarError as error:
        raise archive(info.name[:200], f"cannot be read ({error})") from None


class _Stream(io.RawIOBase):
    """Pieces as a file that is read from its start to its end."""

    def __init__(self, chunks: Iterator[bytes]) -> None:
        self._chunks = chunks
        self._chunk, self._at = b"", 0

    def readable(self) -> bool:
        return True

    def read(self, size: int = -1) -> bytes:
        found: list[bytes] = []
        while size > 0:
            if self._at == len(self._chunk):
                self._chunk, self._at = next(self._chunks, b""), 0
                if not self._chunk:
                    break
            found.append(self._chunk[self._at : self._at + size])
            self._at += len(found[-1])
            size -= len(found[-1])
        return b"".join(found)
