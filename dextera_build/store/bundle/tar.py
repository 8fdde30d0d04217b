"""Archives with files and nothing else: what is written is the same for the same files, what is read is checked.

Headers are those of GNU tar (sizes beyond 8 GiB stand in base 256), so no second header ever precedes a file: whatever
needs one (long names, sparse files, extended attributes) is refused, and so are links, devices and folders in layers.
"""

from __future__ import annotations

import tarfile
from collections.abc import Iterator
from dataclasses import dataclass

from dextera_build.store.bundle.refusal import archive

BLOCK = 512
_END = bytes(2 * BLOCK)


@dataclass(frozen=True)
class File:
    """One file of an archive."""

    name: str
    size: int


def header(name: str, size: int) -> bytes:
    """The header of a file, without owner and time."""
    info = tarfile.TarInfo(name)
    info.size, info.mode = size, 0o444
    return info.tobuf(tarfile.GNU_FORMAT, "ascii", "strict")


def padding(size: int) -> bytes:
    """What follows `size` bytes of content."""
    return bytes(-size % BLOCK)


def length(sizes: Iterator[int]) -> int:
    """Bytes of an archive with files of these sizes."""
    return sum(BLOCK + size + -size % BLOCK for size in sizes) + len(_END)


def end() -> bytes:
    """What follows the last file."""
    return _END


def read_header(block: bytes, *, folders: bool = False) -> File | None:
    """The file that a header announces; None for the end, a size of -1 for a folder where `folders` may stand.

    Raises:
        BundleRefused: It is no header, or announces something else.
    """
    if block == bytes(BLOCK):
        return None
    try:
        info = tarfile.TarInfo.frombuf(block, "utf-8", "strict")
    except (tarfile.HeaderError, ValueError) as error:
        raise archive("?", f"is no header of a tar archive ({error})") from None
    name = info.name if info.name.isprintable() else repr(info.name)
    if folders and info.type == tarfile.DIRTYPE:
        return File(info.name, -1)
    if info.type not in (tarfile.REGTYPE, tarfile.AREGTYPE):
        raise archive(name, f"is {_KINDS.get(info.type, 'no plain file')}")
    if info.size < 0:
        raise archive(name, "has a negative size")
    return File(info.name, info.size)


class Reader:
    """The files of an archive that comes in pieces, one after the other.

    Args:
        chunks: Its bytes.
    """

    def __init__(self, chunks: Iterator[bytes]) -> None:
        self._chunks = chunks
        self._rest = b""

    def files(self) -> Iterator[tuple[File, Iterator[bytes]]]:
        """Each file with its content, which is to be read to its end before the next is asked for.

        Raises:
            BundleRefused: The archive ends too early, or holds something else.
        """
        while (found := read_header(self._exactly(BLOCK))) is not None:
            yield found, self._pieces(found.size)
            self._exactly(-found.size % BLOCK)
        # To the end in any case: there whoever counts and digests the bytes says that they are others.
        rest = bool(self._rest.strip(b"\0"))
        for chunk in self._chunks:
            rest = rest or bool(chunk.strip(b"\0"))
        if rest:
            raise archive("?", "stands after the end")

    def _exactly(self, size: int) -> bytes:
        return b"".join(self._pieces(size))

    def _pieces(self, size: int) -> Iterator[bytes]:
        while size:
            piece = self._rest or next(self._chunks, b"")
            if not piece:
                raise archive("?", "is cut off")
            taken, self._rest = piece[:size], piece[size:]
            size -= len(taken)
            yield taken


_KINDS = {
    tarfile.SYMTYPE: "a symbolic link",
    tarfile.LNKTYPE: "a hard link",
    tarfile.CHRTYPE: "a device",
    tarfile.BLKTYPE: "a device",
    tarfile.FIFOTYPE: "a pipe",
    tarfile.DIRTYPE: "a folder",
    tarfile.GNUTYPE_SPARSE: "a sparse file",
    tarfile.GNUTYPE_LONGNAME: "a long name",
    tarfile.GNUTYPE_LONGLINK: "a long name",
    tarfile.XHDTYPE: "an extended header",
    tarfile.XGLTYPE: "an extended header",
}
