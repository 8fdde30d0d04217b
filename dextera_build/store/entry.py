"""The format of an entry: the result under a key in a store or a remote; bundles hold its second line.

An entry is two lines of canonical JSON:

    {"files":[["output","3b9c...",345],["key","f00d...",2211],["blob","77ab...",12]],"result":"51d0..."}
    {"key_document":"f00d...","line":"12 views","output":"3b9c...",...}

The first line names the blobs that the result needs and the digest of the second line, which is the result. The size of
a blob is null in a *bare* entry if its bytes are absent by design.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

from dextera_build import digest as digests
from dextera_build.store.blobs import is_digest

OUTPUT, HEADER, BLOB, KEY, BESIDE = ("output", "header", "blob", "key", "beside")
"""Roles of blobs: the header of the output, further headers and blobs that it refers to, the key document, and
everything else: previews, the log, recorded calls and their answers."""
HEADERS = frozenset((OUTPUT, HEADER, KEY))
"""Roles of the blobs that even a bare result needs."""
_ROLES = HEADERS | {BLOB, BESIDE}
_MOST_BYTES = 1 << 48
S = TypeVar("S")
T = TypeVar("T")
_FIELDS = frozenset(("output", "line", "previews", "metrics", "seconds", "log", "key_document"))


class File(NamedTuple):
    """One blob that an entry needs."""

    role: str
    digest: str
    size: int | None
    """[bytes]; None if the bytes are absent by design."""


@dataclass(frozen=True, slots=True)
class ActionResult:
    """The result of one run of a rule."""

    output: str
    """Digest of the output's header."""
    line: str
    """The rule's one-line summary of its result."""
    previews: tuple[tuple[str, str], ...]
    """(caption, digest of a PNG)."""
    metrics: Mapping[str, tuple[float, str]]
    """Name -> (value, unit)."""
    seconds: float
    """How long the rule ran [s]."""
    log: str | None
    """Digest of its log, None if it printed nothing."""
    key_document: str
    """Digest of the key document, which is the key."""
    calls: tuple[tuple[str, str], ...] = ()
    """(key, digest of the result) of recorded calls that the run made."""

    @property
    def document(self) -> bytes:
        """This result as canonical JSON.

        Raises:
            ValueError: A number is not finite.
        """
        calls = {"calls": [list(pair) for pair in self.calls]} if self.calls else {}
        return digests.canonical(
            {
                **calls,
                "output": self.output,
                "line": self.line,
                "previews": [list(pair) for pair in self.previews],
                "metrics": {name: list(pair) for name, pair in self.metrics.items()},
                "seconds": self.seconds,
                "log": self.log,
                "key_document": self.key_document,
            }
        )

    @property
    def digest(self) -> str:
        """Digest of `document`."""
        return digests.of_bytes(self.document)

    @property
    def called(self) -> tuple[Mapping[str, str], ...]:
        """The recorded calls in the form that events and records use."""
        return tuple({"call": key} for key, _ in self.calls)

    @property
    def is_record(self) -> bool:
        """Whether this can be the result of a recorded call."""
        return not (self.calls or self.previews or self.log)

    @classmethod
    def from_document(cls, data: bytes) -> ActionResult:
        """Parse an untrusted `document`.

        Raises:
            ValueError: It is not a result.
        """
        raw = digests.plain(data)
        if not isinstance(raw, dict) or raw.keys() - {"calls"} != _FIELDS:
            raise ValueError("not a result")
        if not isinstance(raw["metrics"], dict) or raw.get("calls") == []:  # a result has one encoding
            raise ValueError("not a result")
        return cls(
            output=_digest(raw["output"]),
            line=_text(raw["line"]),
            previews=_pairs(raw["previews"], _text, _digest),
            metrics=dict(
                zip(map(_text, raw["metrics"]), _pairs([*raw["metrics"].values()], _number, _text), strict=True)
            ),
            seconds=_number(raw["seconds"]),
            log=None if raw["log"] is None else _digest(raw["log"]),
            key_document=_digest(raw["key_document"]),
            calls=_pairs(raw.get("calls", []), _digest, _digest),
        )


@dataclass(frozen=True, slots=True)
class Entry:
    """A result and the blobs that it needs."""

    result: ActionResult
    files: tuple[File, ...]
    """The blobs that it needs, without duplicates, the header of the output first."""

    @property
    def key(self) -> str:
        """The key of this entry."""
        return self.result.key_document

    @property
    def is_bare(self) -> bool:
        """Whether bytes are absent by design."""
        return any(file.size is None for file in self.files)

    @property
    def refers(self) -> frozenset[str]:
        """Digests of the artifacts and blobs that the output refers to."""
        return frozenset(file.digest for file in self.files if file.role in (HEADER, BLOB))

    def spell(self) -> bytes:
        """Encode this entry."""
        document = self.result.document
        head = {"files": [list(file) for file in self.files], "result": digests.of_bytes(document)}
        return digests.canonical(head) + b"\n" + document


def read(data: bytes) -> Entry:
    """Parse an untrusted entry and check that its digests agree.

    Raises:
        ValueError: The bytes are not an entry.
    """
    head, _, document = data.partition(b"\n")
    raw = digests.plain(head)
    if not isinstance(raw, dict) or raw.keys() != {"files", "result"} or not isinstance(raw["files"], list):
        raise ValueError("not an entry")
    if digests.of_bytes(document) != raw["result"]:
        raise ValueError("its result has another digest")
    result = ActionResult.from_document(document)
    files = tuple(map(_file, raw["files"]))
    named = [(file.role, file.digest) for file in files if file.role in (OUTPUT, KEY)]
    if named != [(OUTPUT, result.output), (KEY, result.key_document)] or files[0].role != OUTPUT:
        raise ValueError("it does not name its output and its key document")
    return Entry(result, files)


def _file(row: Any) -> File:
    if isinstance(row, list) and len(row) == 3 and type(row[0]) is type(row[1]) is str:
        role, digest, size = row
        has_size = type(size) is int and 0 <= size < _MOST_BYTES
        if role in _ROLES and is_digest(digest) and (has_size or (size is None and role not in HEADERS)):
            return File(role, digest, size)
    raise ValueError("it names something that cannot be a blob")


def _pairs(rows: object, first: Callable[[object], S], second: Callable[[object], T]) -> tuple[tuple[S, T], ...]:
    if rows == []:  # the common case
        return ()
    if isinstance(rows, list) and all(isinstance(row, list) and len(row) == 2 for row in rows):
        return tuple((first(one), second(other)) for one, other in rows)
    raise ValueError("not a list of pairs")


def _text(value: object) -> str:
    if isinstance(value, str):
        value.encode()  # JSON can spell half a surrogate pair, which UTF-8 refuses by a ValueError
        return value
    raise ValueError("not a text")


def _digest(value: object) -> str:
    if isinstance(value, str) and is_digest(value):
        return value
    raise ValueError("not a digest")


def _number(value: object) -> float:
    # `math.isfinite` raises for integers beyond the range of floats.
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max:
        return value
    raise ValueError("not a finite number")
