"""`ActionResult` messages of the Remote Execution API as bytes: the few fields that we use, without a library.

ActionResult { repeated OutputFile output_files = 2; int32 exit_code = 4; }
OutputFile   { string path = 1; Digest digest = 2; bytes contents = 5; }
Digest       { string hash = 1; int64 size_bytes = 2; }
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from dextera_build.store.cas import is_digest


@dataclass(frozen=True, slots=True)
class OutputFile:
    """One blob that an entry needs."""

    path: str
    digest: str
    size: int
    contents: bytes = b""


def encode(outputs: Iterable[OutputFile]) -> bytes:
    """The bytes of an `ActionResult` message with exit code 0 and these output files."""
    message = bytearray()
    for file in outputs:
        digest = _field(1, file.digest.encode()) + b"\x10" + _varint(file.size)
        body = _field(1, file.path.encode()) + _field(2, digest)
        if file.contents:
            body += _field(5, file.contents)
        message += _field(2, body)
    return bytes(message)


def decode(data: bytes) -> list[OutputFile]:
    """The output files of an `ActionResult` message; fields that we do not write are passed over.

    Raises:
        ValueError: The bytes are not such a message, or its exit code is not 0.
        IndexError: The bytes end too early.
        KeyError: An output file lacks its path or digest.
    """
    outputs = []
    for number, value in _fields(data):
        if number == 2 and isinstance(value, bytes):
            file = dict(_fields(value))
            digest = dict(_fields(_bytes(file[2])))
            size = digest.get(2, 0)
            if not isinstance(size, int):
                raise ValueError("a size is not a number")
            name, contents = _bytes(digest[1]).decode(), _bytes(file.get(5, b""))
            if not is_digest(name):
                raise ValueError("not a SHA-256 digest")
            outputs.append(OutputFile(_bytes(file[1]).decode(), name, size, contents))
        elif number == 4 and value:
            raise ValueError("a failed action")
    if not outputs:
        raise ValueError("no output files")
    return outputs


def _bytes(value: int | bytes) -> bytes:
    if isinstance(value, int):
        raise ValueError("bytes are needed here")
    return value


def _field(number: int, body: bytes) -> bytes:
    return bytes((number << 3 | 2,)) + _varint(len(body)) + body


def _varint(value: int) -> bytes:
    if value < 0x80:
        return bytes((value,))
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def _fields(data: bytes) -> Iterator[tuple[int, int | bytes]]:
    """Field number and value of each field of a message; fixed-width values come as bytes."""
    place, end = 0, len(data)
    while place < end:
        tag, place = _read_varint(data, place)
        wire = tag & 7
        if wire == 0:
            number, place = _read_varint(data, place)
            yield tag >> 3, number
            continue
        if wire == 2:
            length, place = _read_varint(data, place)
        elif wire in (1, 5):
            length = 8 if wire == 1 else 4
        else:
            raise ValueError("unknown wire type")
        if place + length > end:
            raise ValueError("the message ends too early")
        yield tag >> 3, data[place : place + length]
        place += length


def _read_varint(data: bytes, place: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = data[place]
        place += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, place
        shift += 7
        if shift > 63:
            raise ValueError("a number is too long")
