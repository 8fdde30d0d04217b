"""Safetensors files: an index of tensors in JSON, then their bytes (the format of Hugging Face, version 0.4 and later).

The layout is eight bytes with the length of the index, the index, and the consecutive tensors without gaps. Such a file
contains no executable code.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Iterator, Mapping
from typing import Any, BinaryIO, NamedTuple

import numpy as np

BITS = {
    "BOOL": 8,
    "U8": 8,
    "I8": 8,
    "F8_E5M2": 8,
    "F8_E4M3": 8,
    "U16": 16,
    "I16": 16,
    "F16": 16,
    "BF16": 16,
    "U32": 32,
    "I32": 32,
    "F32": 32,
    "U64": 64,
    "I64": 64,
    "F64": 64,
}
"""Numeric type in the index -> bits per number."""
_NUMPY = {
    "BOOL": "bool",
    "U8": "uint8",
    "I8": "int8",
    "U16": "uint16",
    "I16": "int16",
    "F16": "float16",
    "U32": "uint32",
    "I32": "int32",
    "F32": "float32",
    "U64": "uint64",
    "I64": "int64",
    "F64": "float64",
}
_TYPES = {name: kind for kind, name in _NUMPY.items()}
_LONGEST_INDEX = 100_000_000
"""Maximum length [bytes], as in the library of the format, so that an untrusted index cannot fill the memory."""
_PIECE = 1 << 24
"""Number of bytes copied at once."""


class Span(NamedTuple):
    """One tensor of a file."""

    dtype: str
    """Key of `BITS`."""
    shape: tuple[int, ...]
    begin: int
    """First byte in the file."""
    end: int
    """Byte after the last."""


def index(file: BinaryIO, size: int) -> tuple[dict[str, Span], dict[str, str]]:
    """Tensors by name, in the order of their bytes, and the notes of a file of `size` bytes.

    Raises:
        ValueError: The index is damaged, or the file does not have the stated length.
    """
    head = file.read(8)
    length = struct.unpack("<Q", head)[0] if len(head) == 8 else 0
    if not 2 <= length <= min(_LONGEST_INDEX, size - 8):
        raise ValueError("it does not begin with an index of tensors")
    try:
        said = json.loads(file.read(length))
        notes = {str(name): str(text) for name, text in said.pop("__metadata__", {}).items()}
        spans = {name: _span(entry, 8 + length) for name, entry in said.items()}
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"its index of tensors is damaged: {error!r}") from None
    place = 8 + length
    for name, span in sorted(spans.items(), key=lambda item: (item[1].begin, item[1].end)):
        wanted = math.prod(span.shape) * BITS[span.dtype] // 8
        if span.begin != place or span.end - span.begin != wanted:
            raise ValueError(f"the bytes of tensor `{name}` are not where its index says")
        place = span.end
    if place != size:
        raise ValueError(f"it has {size:,} bytes, but its index says {place:,}")
    return dict(sorted(spans.items(), key=lambda item: item[1].begin)), notes


def header(tensors: Mapping[str, tuple[str, tuple[int, ...]]], notes: Mapping[str, str]) -> bytes:
    """The beginning of a file with these tensors (type, shape) in this order; equal tensors give equal bytes."""
    said: dict[str, Any] = {"__metadata__": dict(sorted(notes.items()))} if notes else {}
    place = 0
    for name, (dtype, shape) in tensors.items():
        end = place + math.prod(shape) * BITS[dtype] // 8
        said[name] = {"dtype": dtype, "shape": list(shape), "data_offsets": [place, end]}
        place = end
    text = json.dumps(said, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)  # aligns the tensors
    return struct.pack("<Q", len(text)) + text


def pieces(file: BinaryIO, span: Span) -> Iterator[bytes]:
    """The bytes of a tensor, some megabytes at a time."""
    file.seek(span.begin)
    left = span.end - span.begin
    while left:
        data = file.read(min(left, _PIECE))
        if not data:
            raise ValueError("it is cut short")
        left -= len(data)
        yield data


def array(data: bytes, dtype: str, shape: tuple[int, ...]) -> np.ndarray:
    """The numbers of a tensor; BF16 is converted to float32, without loss.

    Raises:
        ValueError: NumPy has no such type.
    """
    if dtype == "BF16":
        wide = np.frombuffer(data, "<u2").astype(np.uint32) << 16
        return wide.view(np.float32).reshape(shape)
    if dtype not in _NUMPY:
        raise ValueError(f"NumPy has no numbers of type {dtype}")
    return np.frombuffer(data, np.dtype(_NUMPY[dtype]).newbyteorder("<")).astype(_NUMPY[dtype]).reshape(shape)


def type_of(numbers: np.ndarray) -> str:
    """The key of `BITS` for an array.

    Raises:
        ValueError: The format has no such type.
    """
    if numbers.dtype.name not in _TYPES:
        raise ValueError(f"safetensors has no numbers of type {numbers.dtype.name}")
    return _TYPES[numbers.dtype.name]


def _span(entry: Mapping[str, Any], start: int) -> Span:
    begin, end = entry["data_offsets"]
    dtype, shape = entry["dtype"], tuple(entry["shape"])
    if dtype not in BITS:
        raise ValueError(f"numbers of the unknown type {dtype}")
    if not all(isinstance(size, int) and size >= 0 for size in (*shape, begin, end)):
        raise ValueError("a size is no whole number")
    return Span(dtype, shape, start + begin, start + end)
