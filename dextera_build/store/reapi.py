"""`ActionResult` messages of the Remote Execution API as bytes: the few fields that we use, without a library.

ActionResult { repeated OutputFile output_files = 2; int32 exit_code = 4; }
OutputFile   { string path = 1; Digest digest = 2; bytes contents = 5; }
Digest       { string hash = 1; int64 size_bytes = 2; }
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from dextera_build import digest as digests
from dextera_build.store.cas import is_digest
from dextera_build.store.wire import field, fields, varint

_ONE_BYTE = 1 << 7
"""Lengths below it take one byte."""


class OutputFile(NamedTuple):
    """One blob that an entry needs."""

    path: str
    digest: str
    size: int
    contents: bytes = b""
    """Its bytes, where the entry holds them itself."""


def encode(outputs: Iterable[OutputFile]) -> bytes:
    """The bytes of an `ActionResult` message with exit code 0 and these output files."""
    return b"".join(_spelled(file) for file in outputs)


def _spelled(file: OutputFile) -> bytes:
    path, digest, size = file.path.encode(), file.digest.encode(), varint(file.size)
    inner = len(digest) + len(size) + 3
    if len(path) < _ONE_BYTE and inner < _ONE_BYTE:
        # Nearly all files; field by field takes several times as long.
        body = b"\n%c%b\x12%c\n%c%b\x10%b" % (len(path), path, inner, len(digest), digest, size)
    else:
        body = field(1, path) + field(2, field(1, digest) + b"\x10" + size)
    if file.contents:
        body += field(5, file.contents)
    return field(2, body)


def decode(data: bytes) -> list[OutputFile]:
    """The output files of an `ActionResult` message; fields that we do not write are passed over.

    Raises:
        ValueError: The bytes are not such a message, an output file lacks its path or digest, holds other bytes than
            its digest says, or the action failed.
    """
    outputs = []
    for number, value in fields(data):
        if number == 2 and isinstance(value, bytes):
            outputs.append(_output_file(dict(fields(value))))
        elif number == 4 and value:
            raise ValueError("a failed action")
    if not outputs:
        raise ValueError("no output files")
    return outputs


def _output_file(file: dict[int, int | bytes]) -> OutputFile:
    digest = dict(fields(_bytes(file, 2)))
    size, name = digest.get(2, 0), _bytes(digest, 1).decode()
    if not isinstance(size, int) or size >> 63:
        raise ValueError("not a size")
    if not is_digest(name):
        raise ValueError("not a SHA-256 digest")
    contents = _bytes(file, 5) if 5 in file else b""
    if contents and (len(contents), digests.of_bytes(contents)) != (size, name):
        raise ValueError("other bytes than the digest says")
    return OutputFile(_bytes(file, 1).decode(), name, size, contents)


def _bytes(message: dict[int, int | bytes], number: int) -> bytes:
    value = message.get(number)
    if not isinstance(value, bytes):
        raise ValueError(f"field {number} must hold bytes")
    return value
