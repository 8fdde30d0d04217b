"""Sizes of the chunks of an MCAP file before they are unpacked: 45 kB can expand to gigabytes.

https://mcap.dev/spec#chunk-op0x06
"""

from __future__ import annotations

import os
import struct
from collections.abc import Sequence
from typing import IO, Any

from dextera_build.formats import bounds

MOST_BYTES = 1 << 28
"""Maximum unpacked size of chunks that overlap in time, which a reader holds at once [bytes]."""
_CHUNK = 6
"""Opcode of a chunk."""
_HEADER = struct.Struct("<BQQQQII")
"""Opcode, length, times of the first and last message, unpacked size, checksum, length of the compression's name."""
_FRAME = 64
"""Bytes with the length of the packed records and the header of their frame."""


def check(stream: IO[bytes], name: str, index: Sequence[Any]) -> None:
    """Raise for a file whose chunks unpack to too much.

    Args:
        stream: The file.
        name: Its name.
        index: Its `mcap.records.ChunkIndex` records.

    Raises:
        ValueError: A chunk is larger than stated in the index, or the file has chunks without an index.
        ArtifactError: Chunks that overlap in time are too large together.
    """
    if not index and _has_chunks(stream):
        raise ValueError("it has no index of its chunks; `mcap recover FILE -o FIXED`")
    changes: list[tuple[int, int, int]] = []
    for each in index:
        if _size(stream, each.chunk_start_offset) > each.uncompressed_size:
            raise ValueError("a chunk is larger than its size in the index; `mcap recover FILE -o FIXED`")
        changes.append((each.message_start_time, 0, each.uncompressed_size))
        changes.append((each.message_end_time, 1, -each.uncompressed_size))
    at_once = 0
    for _, _, change in sorted(changes):
        at_once += change
        bounds.check(
            name, "bytes at the same time", at_once, MOST_BYTES, "`mcap sort FILE -o SORTED`, or write smaller chunks"
        )


def _size(stream: IO[bytes], offset: int) -> int:
    """Unpacked size of the chunk at an offset, as stated in its own header and that of its packed records."""
    stream.seek(offset)
    opcode, _, _, _, size, _, length = _HEADER.unpack(stream.read(_HEADER.size))
    if opcode != _CHUNK:
        raise ValueError("the index names a chunk where there is none")
    compression, frame = stream.read(min(length, _FRAME)), stream.read(_FRAME)[8:]
    if compression == b"zstd":
        import zstandard

        return max(int(size), zstandard.frame_content_size(frame))
    return int(size)


def _has_chunks(stream: IO[bytes]) -> bool:
    """Whether a chunk is among the records of a file."""
    end = stream.seek(0, os.SEEK_END)
    place = 8
    while place + 9 <= end:
        stream.seek(place)
        opcode, length = struct.unpack("<BQ", stream.read(9))
        if opcode == _CHUNK:
            return True
        place += 9 + length
    return False
