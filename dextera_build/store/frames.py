"""A file of a JSON head, binary columns and a heap, with a check sum over all of it: for what is local to a machine."""

from __future__ import annotations

import json
import struct
import zlib
from array import array
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

from dextera_build import digest as digests
from dextera_build.store import files

_FORM = 3
_FRAME = struct.Struct("<8sQI")
_MAGIC = b"dxbplan1"
Part: TypeAlias = bytes | bytearray | memoryview


def write(path: str, head: Mapping[str, Any], parts: Sequence[Part], framed: int | None = None) -> None:
    """Write a frame, the head, and parts; those after the first `framed` are one heap.

    Raises:
        StoreError: The store cannot take it.
    """
    framed = len(parts) if framed is None else framed
    sizes = [len(part) for part in parts[:framed]]
    text = json.dumps({**head, "form": _FORM, "sizes": sizes}).encode()
    check = zlib.crc32(text)
    for part in parts:
        check = zlib.crc32(part, check)
    with files.new_file(path, 0o644) as target:
        files.write_all(target, _FRAME.pack(_MAGIC, len(text), check) + text)
        for part in parts:
            files.write_all(target, part)


def read(path: str) -> tuple[dict[str, Any], list[memoryview], memoryview]:
    """Head, parts and heap of what `write` wrote.

    Raises:
        OSError: There is no such file.
        ValueError: It was damaged, or another version wrote it.
    """
    data = memoryview(files.read(path))
    try:
        magic, size, check = _FRAME.unpack_from(data)
    except struct.error:
        raise ValueError("too short") from None
    if magic != _MAGIC or zlib.crc32(data[_FRAME.size :]) != check:
        raise ValueError("damaged")
    place = _FRAME.size + size
    head: dict[str, Any] = digests.plain(bytes(data[_FRAME.size : place]))
    if head["form"] != _FORM:
        raise ValueError("another form")
    parts = []
    for length in head["sizes"]:
        parts.append(data[place : place + length])
        place += length
    return head, parts, data[place:]


def part(column: bytearray | array[Any]) -> memoryview:
    """Numbers or bytes as a part, where they lie."""
    return memoryview(column).cast("B")


def numbers(kind: str, part: memoryview) -> array[Any]:
    """A part as numbers."""
    found = array(kind)
    found.frombytes(part)
    return found
