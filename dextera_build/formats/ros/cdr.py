"""Common Data Representation, little-endian: the serialization of ROS 2 messages."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import Self

import numpy as np

ENCAPSULATION = b"\x00\x01\x00\x00"
"""Plain CDR, little-endian."""


class Cdr:
    """Writer of one message; every method appends and returns the writer. Values are aligned to their size."""

    def __init__(self) -> None:
        self._body = bytearray()

    def u32(self, *values: int) -> Self:
        """Unsigned 32-bit numbers."""
        return self._put("I", values)

    def i32(self, *values: int) -> Self:
        """Signed 32-bit numbers."""
        return self._put("i", values)

    def boolean(self, value: bool) -> Self:
        """One boolean."""
        self._body.append(value)
        return self

    def f64(self, values: Iterable[float] | np.ndarray) -> Self:
        """A fixed number of doubles, without a count."""
        return self._put("d", [float(value) for value in values])

    def f64s(self, values: Iterable[float] | np.ndarray = ()) -> Self:
        """A sequence of doubles: count, then values."""
        listed = list(values)
        return self.u32(len(listed)).f64(listed)

    def rows(self, values: np.ndarray) -> Self:
        """A sequence of structures of equal numbers (N, K), float64 or float32: the count N, then the numbers."""
        self.u32(len(values))
        if values.size:
            self._body += b"\0" * (-len(self._body) % values.itemsize)
            self._body += np.ascontiguousarray(values, values.dtype.newbyteorder("<")).tobytes()
        return self

    def f32(self, values: Iterable[float] | np.ndarray) -> Self:
        """A fixed number of floats, without a count."""
        return self._put("f", [float(value) for value in values])

    def string(self, text: str) -> Self:
        """A string with its terminator."""
        data = text.encode() + b"\0"
        self.u32(len(data))
        self._body += data
        return self

    def strings(self, texts: Iterable[str]) -> Self:
        """A sequence of strings."""
        listed = list(texts)
        self.u32(len(listed))
        for text in listed:
            self.string(text)
        return self

    def u8s(self, data: bytes) -> Self:
        """A sequence of bytes."""
        self.u32(len(data))
        self._body += data
        return self

    def bytes(self) -> bytes:
        """The message with its encapsulation header."""
        return ENCAPSULATION + bytes(self._body)

    def _put(self, code: str, values: Iterable[float]) -> Self:
        listed = list(values)
        if listed:
            self._body += b"\0" * (-len(self._body) % struct.calcsize(code))
            self._body += struct.pack(f"<{len(listed)}{code}", *listed)
        return self
