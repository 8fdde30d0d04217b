"""The action cache: key -> what the run of that key made.

An entry is an `ActionResult` message of the Remote Execution API (build.bazel.remote.execution.v2), so that existing
cache servers hold and check it. Its `output_files` name every blob that the entry needs to be of use: the output's
header and all that it refers to, previews, log, key document, and `result.json` with the rest (also inline).
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from dextera_build import digest as digests
from dextera_build.store import files, header
from dextera_build.store.cas import Blobs, MissingBlob

_RESULT = "result.json"


@dataclass(frozen=True)
class ActionResult:
    """What one run of a rule made."""

    output: str
    """Digest of the output's header."""
    line: str
    """The one line that the rule said about its result."""
    previews: tuple[tuple[str, str], ...]
    """(caption, digest of a PNG)."""
    metrics: Mapping[str, tuple[float, str]]
    """Name -> (value, unit)."""
    seconds: float
    """How long the rule ran [s]."""
    log: str | None
    """Digest of what it printed, None where it printed nothing."""
    key_document: str
    """Digest of the key document."""

    @cached_property
    def document(self) -> bytes:
        """This result as canonical JSON; the content of `result.json`.

        Raises:
            ValueError: A number is not finite.
        """
        return digests.canonical(
            {
                "output": self.output,
                "line": self.line,
                "previews": [list(pair) for pair in self.previews],
                "metrics": {name: list(pair) for name, pair in self.metrics.items()},
                "seconds": self.seconds,
                "log": self.log,
                "key_document": self.key_document,
            }
        )

    @cached_property
    def digest(self) -> str:
        """Digest of `document`."""
        return digests.of_bytes(self.document)

    @classmethod
    def from_document(cls, data: bytes) -> ActionResult:
        """The result that `document` described."""
        raw: dict[str, Any] = json.loads(data)
        return cls(
            output=raw["output"],
            line=raw["line"],
            previews=tuple((caption, blob) for caption, blob in raw["previews"]),
            metrics={name: (value, unit) for name, (value, unit) in raw["metrics"].items()},
            seconds=raw["seconds"],
            log=raw["log"],
            key_document=raw["key_document"],
        )


@dataclass(frozen=True)
class OutputFile:
    """One blob that an entry needs."""

    path: str
    digest: str
    size: int
    contents: bytes = b""


class Actions:
    """Results below one folder.

    Args:
        root: The folder; made when the first result comes.
        blobs: Where everything lies that results refer to.
    """

    def __init__(self, root: Path, blobs: Blobs) -> None:
        self.root = root
        self._base = f"{root}/"
        self._workshop = f"{root}/{files.TEMPORARY}"
        self._blobs = blobs
        self._direct: dict[str, tuple[list[str], list[str]]] = {}

    def get(self, key: str) -> ActionResult | None:
        """The result of `key`, or None where there is none or a blob that it needs is gone or has another size."""
        outputs = self._entry(key)
        if outputs is None:
            return None
        for file in outputs:
            size = self._blobs.size(file.digest)
            if size != file.size:
                if size is not None:
                    self._blobs.quarantine(file.digest)
                return None
        return self._result(outputs)

    def put(self, key: str, result: ActionResult) -> str:
        """Store the result of `key` after all that it needs, and return the digest of its `result.json`.

        Raises:
            MissingBlob: The result refers to something that is not in the store.
            StoreError: The disk is full, or the store cannot be written.
            ValueError: A number is not finite.
        """
        self._blobs.put(result.document)
        outputs = [*self._needs(result), OutputFile(_RESULT, result.digest, len(result.document), result.document)]
        files.write(self._file(key), encode(outputs), workshop=self._workshop)
        return result.digest

    def files(self, key: str) -> list[Path]:
        """The entry and every blob that it needs, as files; empty where there is no entry."""
        outputs = self._entry(key)
        if outputs is None:
            return []
        return [Path(self._file(key)), *(self._blobs.path(file.digest) for file in outputs)]

    def _entry(self, key: str) -> list[OutputFile] | None:
        path = self._file(key)
        try:
            data = files.read(path)
        except OSError:
            return None
        try:
            return decode(data)
        except (ValueError, IndexError, KeyError):
            with suppress(OSError):
                os.unlink(path)
            return None

    def _result(self, outputs: list[OutputFile]) -> ActionResult | None:
        last = outputs[-1]
        try:
            data = last.contents or self._blobs.get(last.digest)
            if last.path != _RESULT or digests.of_bytes(data) != last.digest:
                return None
            return ActionResult.from_document(data)
        except (MissingBlob, ValueError, KeyError, TypeError):
            return None

    def _needs(self, result: ActionResult) -> Iterator[OutputFile]:
        yield self._sized("output", result.output)
        for digest in self._closure(result.output):
            yield self._sized(f"closure/{digest}", digest)
        for place, (_, digest) in enumerate(result.previews):
            yield self._sized(f"previews/{place}.png", digest)
        if result.log is not None:
            yield self._sized("log", result.log)
        yield self._sized("key.json", result.key_document)

    def _sized(self, path: str, digest: str) -> OutputFile:
        size = self._blobs.size(digest)
        if size is None:
            raise MissingBlob(digest)
        return OutputFile(path, digest, size)

    def _closure(self, output: str) -> list[str]:
        """Everything that `output` refers to, through all artifacts, each once."""
        found: dict[str, None] = {}
        seen = {output}
        stack = [output]
        while stack:
            refs, blobs = self._directly(stack.pop())
            found.update(dict.fromkeys(blobs))
            fresh = [ref for ref in dict.fromkeys(refs) if ref not in seen]
            seen.update(fresh)
            found.update(dict.fromkeys(fresh))
            stack += fresh
        found.pop(output, None)
        return list(found)

    def _directly(self, digest: str) -> tuple[list[str], list[str]]:
        if digest not in self._direct:
            self._direct[digest] = header.closure(self._blobs.get(digest))
        return self._direct[digest]

    def _file(self, key: str) -> str:
        return f"{self._base}{key[:2]}/{key[2:]}"


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
            contents = _bytes(file.get(5, b""))
            outputs.append(OutputFile(_bytes(file[1]).decode(), _bytes(digest[1]).decode(), size, contents))
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
