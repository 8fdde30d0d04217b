"""Protocol buffers as bytes: the wire format, and messages that are described by the annotations of a class.

A message is a dataclass or `NamedTuple` of fields `name: Annotated[type, number]`. A type is `str`, `bytes`, `int` (of
int32, int64 and enums), `bool`, another message, or a `tuple[type, ...]` of those. Whatever bytes come in, reading them
ends in a message or in a `ValueError`, and takes memory in proportion to their number.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple, TypeVar, get_args, get_origin, get_type_hints

T = TypeVar("T")

_VARINT, _BYTES = 0, 2
_WIDTHS = {1: 8, 5: 4}
"""Wire type of fixed width -> its number of bytes."""
_WORD = 1 << 64
_MOST_TAG = 1 << 32


def encode(message: object) -> bytes:
    """The bytes of a message; fields that hold their default are left out, as in proto3."""
    parts: list[bytes] = []
    for field in _fields_of(type(message)):
        value = getattr(message, field.name)
        if field.repeated and field.kind in (int, bool):
            value = (b"".join(varint(number) for number in value),) if value else ()
        for one in value if field.repeated else (value,):
            if field.repeated or one != field.default:
                _write(field.number, one, parts)
    return b"".join(parts)


def decode(kind: type[T], data: bytes) -> T:
    """The message of class `kind` that these bytes hold; fields that it does not name are passed over.

    Raises:
        ValueError: The bytes are not such a message.
    """
    known = {field.number: field for field in _fields_of(kind)}
    found: dict[int, list[Any]] = {}
    for number, value in fields(data):
        if number in known:
            found.setdefault(number, []).append(value)
    read = {known[number].name: _read(known[number], values) for number, values in found.items()}
    return kind(**{field.name: field.default for field in known.values()} | read)


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


def signed(value: int) -> int:
    """What an int32 or int64 field means whose bits were read as `value`."""
    return value - _WORD if value >= _WORD >> 1 else value


class _Field(NamedTuple):
    number: int
    name: str
    kind: type
    repeated: bool
    default: Any


_SHAPES: dict[type, tuple[_Field, ...]] = {}


def _fields_of(kind: type) -> tuple[_Field, ...]:
    if kind in _SHAPES:
        return _SHAPES[kind]
    found = []
    for name, hint in get_type_hints(kind, include_extras=True).items():
        inner, number = get_args(hint)
        repeated = get_origin(inner) is tuple
        each = get_args(inner)[0] if repeated else inner
        found.append(_Field(number, name, each, repeated, () if repeated else _nothing(each)))
    _SHAPES[kind] = tuple(sorted(found, key=lambda field: field.number))
    return _SHAPES[kind]


def _nothing(kind: type) -> object:
    return kind() if kind in (str, bytes, int, bool) else decode(kind, b"")


def _write(number: int, value: object, parts: list[bytes]) -> None:
    if isinstance(value, int):
        parts += (varint(number << 3), varint(value))
        return
    body = value if isinstance(value, bytes) else value.encode() if isinstance(value, str) else encode(value)
    parts += (varint(number << 3 | _BYTES), varint(len(body)), body)


def _read(field: _Field, values: list[Any]) -> object:
    if field.kind in (int, bool):
        numbers = tuple(field.kind(signed(number)) for value in values for number in _numbers(value, field.repeated))
        return numbers if field.repeated else numbers[-1]
    if any(isinstance(value, int) for value in values):
        raise ValueError(f"field `{field.name}` is a number")
    # Each is read, so that one that counts for nothing is not passed over when it is damaged.
    each = tuple(_one(field.kind, value) for value in values)
    if field.repeated:
        return each
    # The parts of a message that stands there several times belong together; of a value the last one counts.
    return each[-1] if len(each) == 1 or field.kind in (str, bytes) else decode(field.kind, b"".join(values))


def _one(kind: type, value: bytes) -> object:
    if kind is bytes:
        return value
    return value.decode() if kind is str else decode(kind, value)


def _numbers(value: int | bytes, packed: bool) -> Iterator[int]:
    if isinstance(value, int):
        yield value
        return
    if not packed:
        raise ValueError("a number is needed here")
    place = 0
    while place < len(value):
        number, place = _read_varint(value, place)
        yield number


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
