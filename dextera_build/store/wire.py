"""Protocol buffers as bytes: the wire format."""

from __future__ import annotations

from collections.abc import Iterator

_VARINT, _BYTES = 0, 2
_WIDTHS = {1: 8, 5: 4}
"""Wire type of fixed width -> its number of bytes."""
_WORD = 1 << 64
_MOST_TAG = 1 << 32


def fields(data: bytes) -> Iterator[tuple[int, int | bytes]]:
    """Field number and value of each varint and run of bytes; those of fixed width, which none here is, are left out.

    Raises:
        ValueError: The bytes are not a message, or end too early.
    """
    place, end = 0, len(data)
    while place < end:
        tag, place = _read_varint(data, place)
        wire = tag & 7
        if not 8 <= tag < _MOST_TAG:
            raise ValueError("a field number is out of range")
        if wire == _VARINT:
            number, place = _read_varint(data, place)
            yield tag >> 3, number
            continue
        if wire == _BYTES:
            length, place = _read_varint(data, place)
        elif wire in _WIDTHS:
            length = _WIDTHS[wire]
        else:
            raise ValueError("unknown wire type")
        start, place = place, place + length
        if place > end:
            raise ValueError("the message ends too early")
        if wire == _BYTES:
            yield tag >> 3, data[start:place]


def field(number: int, body: bytes) -> bytes:
    """A field that holds bytes, a text or a message."""
    return varint(number << 3 | _BYTES) + varint(len(body)) + body


def varint(value: int) -> bytes:
    """A number; a negative one takes ten bytes."""
    if 0 <= value < 0x80:
        return bytes((value,))
    if 0x80 <= value < 0x4000:
        return bytes((value & 0x7F | 0x80, value >> 7))
    value %= _WORD
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def _read_varint(data: bytes, place: int) -> tuple[int, int]:
    try:
        value = data[place]
        if value < 0x80:
            return value, place + 1
        value &= 0x7F
        for shift in range(7, 70, 7):
            place += 1
            byte = data[place]
            value |= (byte & 0x7F) << shift
            if byte < 0x80 and value < _WORD:
                return value, place + 1
    except IndexError:
        raise ValueError("the message ends too early") from None
    raise ValueError("a number is too long")
