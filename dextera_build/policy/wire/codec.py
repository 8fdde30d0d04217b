"""Messages as msgpack, with numpy's arrays and scalars as openpi packs them.

An array is the map `{b"__ndarray__": True, b"data": bytes, b"dtype": "<f4", b"shape": [3, 2]}`, a scalar
`{b"__npgeneric__": True, b"data": 1.5, b"dtype": "<f4"}` [openpi: packages/openpi-client/.../msgpack_numpy.py].
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

KINDS = "biufSU"
"""Kinds of numpy's types that may be sent: bool, integers, floats, bytes and text; no objects, records, complex."""
_ARRAY, _SCALAR = b"__ndarray__", b"__npgeneric__"
_LONGEST = 16
"""Longest name of a type [characters]."""


class MessageError(ValueError):
    """Bytes that are no message, or a value that a message cannot hold."""


def pack(message: object) -> bytes:
    """The bytes of a message: plain data, arrays and scalars.

    Raises:
        MessageError: It holds something else, such as an array of objects.
    """
    import msgspec

    try:
        return msgspec.msgpack.encode(message, enc_hook=_as_map)
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        raise MessageError(str(error)) from None


def unpack(data: bytes) -> Any:
    """The message in `data`; its arrays are read-only views of `data`.

    Raises:
        MessageError: It is no message.
    """
    import msgspec

    try:
        return _restored(msgspec.msgpack.decode(data))
    except (msgspec.DecodeError, ValueError, OverflowError, RecursionError) as error:  # text that is no UTF-8 as well
        raise MessageError(str(error)) from None


def _as_map(value: Any) -> dict[bytes, Any]:
    if not isinstance(value, np.ndarray | np.generic):
        raise TypeError(f"a message cannot hold a {type(value).__name__}")
    if value.dtype.kind not in KINDS:
        raise TypeError(f"a message cannot hold numbers of type {value.dtype}")
    dtype = value.dtype.str
    if isinstance(value, np.generic):
        return {_SCALAR: True, b"data": value.item(), b"dtype": dtype}
    return {_ARRAY: True, b"data": value.tobytes(), b"dtype": dtype, b"shape": value.shape}


def _restored(value: Any) -> Any:
    if isinstance(value, dict):
        if _ARRAY in value:
            return _array(value)
        if _SCALAR in value:
            return _scalar(value)
        return {key: _restored(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_restored(inner) for inner in value]
    if value is None or isinstance(value, bool | int | float | str | bytes):
        return value
    raise MessageError(f"it holds a {type(value).__name__}")


def _array(parts: dict[Any, Any]) -> np.ndarray:
    dtype, data, shape = _dtype(parts), parts.get(b"data"), parts.get(b"shape")
    if not isinstance(data, bytes) or not isinstance(shape, list):
        raise MessageError("an array lacks its data or its shape")
    if not all(isinstance(size, int) and size >= 0 for size in shape):
        raise MessageError(f"no array has the shape {shape}")
    if math.prod(shape) * dtype.itemsize != len(data):
        raise MessageError(f"an array {tuple(shape)} of {dtype} does not have {len(data)} bytes")
    try:
        return np.ndarray(shape, dtype, data)
    except ValueError as error:  # too many axes
        raise MessageError(str(error)) from None


def _scalar(parts: dict[Any, Any]) -> Any:
    dtype, value = _dtype(parts), parts.get(b"data")
    if not isinstance(value, bool | int | float | str | bytes):
        raise MessageError("a scalar lacks its value")
    try:
        return np.array(value, dtype)[()]
    except (TypeError, ValueError, OverflowError) as error:
        raise MessageError(f"a scalar of {dtype}: {error}") from None


def _dtype(parts: dict[Any, Any]) -> np.dtype[Any]:
    name = parts.get(b"dtype")
    try:
        dtype = np.dtype(name) if isinstance(name, str) and len(name) <= _LONGEST else None
    except (TypeError, ValueError, SyntaxError):
        dtype = None
    if dtype is None or dtype.kind not in KINDS or not dtype.itemsize:
        raise MessageError(f"an array of type {str(name)[:_LONGEST]!r} is not accepted")
    return dtype
