"""The form of an entry: what a store holds under a key, and what remotes and bundles carry of it.

An entry is lines of canonical JSON:

    {"bare":false,"files":[["output","3b9c...",345],["closure","77ab...",12]],"result":"51d0..."}
    {"key_document":"f00d...","line":"12 views","output":"3b9c...",...}
    {"backend":"hull","code":{...},"inputs":[...],...}

The first line names the blobs that the result needs and the digest of the second line, which is the result. The third
is the key document, whose digest is the key; if it is long, or other entries name it, it is one of the blobs instead.

A *bare* entry has bytes that are absent by design: it names only blobs that are there.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from dextera_build import digest as digests
from dextera_build.store.blobs import is_digest

MOST_DOCUMENT = 1 << 16
"""Longer key documents [bytes] are blobs, since an entry is read whenever its key is looked up."""
OUTPUT, CLOSURE, KEY, CALL, ANSWER, PREVIEW, LOG, BESIDE = (
    *("output", "closure", "key", "call", "answer", "preview", "log", "beside"),
)
"""Roles of blobs: the output's header, artifacts and blobs that it refers to, the key document, requests of recorded
calls, their answers, previews, the log, and further blobs that are kept as long as the result."""
_ROLES = frozenset((OUTPUT, CLOSURE, KEY, CALL, ANSWER, PREVIEW, LOG, BESIDE))
_MOST_BYTES = 1 << 48
_FIELDS = frozenset(("output", "line", "previews", "metrics", "seconds", "log", "key_document"))


class File(NamedTuple):
    """One blob that an entry needs."""

    role: str
    digest: str
    size: int
    """[bytes]"""


@dataclass(frozen=True, slots=True)
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
    """Digest of its log, None if it printed nothing."""
    key_document: str
    """Digest of the key document, which is the key."""
    calls: tuple[tuple[str, str], ...] = ()
    """(key, digest of the result) of recorded calls that the run made."""
    _digest: str = field(default="", init=False, repr=False, compare=False)

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
        """Digest of `document`; computed once."""
        if not self._digest:
            self.know(digests.of_bytes(self.document))
        return self._digest

    def know(self, digest: str) -> None:
        """Its digest is known already."""
        object.__setattr__(self, "_digest", digest)

    @property
    def called(self) -> tuple[Mapping[str, str], ...]:
        """The recorded calls, as events and records name them."""
        return tuple({"call": key} for key, _ in self.calls)

    @property
    def is_record(self) -> bool:
        """Whether this can be the result of a recorded call."""
        return not (self.calls or self.previews or self.log)

    @classmethod
    def from_document(cls, data: bytes) -> ActionResult:
        """Parse a `document`, which may come from anywhere.

        Raises:
            ValueError: It is not a result.
        """
        raw = digests.plain(data)
        if not isinstance(raw, dict) or raw.keys() - {"calls"} != _FIELDS or not _is_typed(raw):
            raise ValueError("not a result")
        return cls(
            output=raw["output"],
            line=raw["line"],
            previews=tuple((caption, blob) for caption, blob in raw["previews"]),
            metrics={name: (value, unit) for name, (value, unit) in raw["metrics"].items()},
            seconds=raw["seconds"],
            log=raw["log"],
            key_document=raw["key_document"],
            calls=tuple((key, result) for key, result in raw.get("calls", ())),
        )


@dataclass(frozen=True, slots=True)
class Entry:
    """What lies under a key."""

    result: ActionResult
    files: tuple[File, ...]
    """The blobs that it needs, the output's header first."""
    document: bytes = b""
    """The key document, b"" where it is a blob."""
    is_bare: bool = False

    @property
    def key(self) -> str:
        """The key that it belongs under."""
        return self.result.key_document

    def spell(self) -> bytes:
        """Its bytes."""
        document = self.result.document
        self.result.know(digests.of_bytes(document))
        head = {"bare": self.is_bare, "files": [list(file) for file in self.files], "result": self.result.digest}
        return b"\n".join((digests.canonical(head), document, *((self.document,) if self.document else ())))


def read(data: bytes) -> Entry:
    """Parse an entry, which may come from anywhere; its digests are checked against one another.

    Raises:
        ValueError: The bytes are not an entry.
    """
    head, document, *asked = data.split(b"\n", 2)
    raw = digests.plain(head)
    if not isinstance(raw, dict) or raw.keys() != {"bare", "files", "result"} or type(raw["bare"]) is not bool:
        raise ValueError("not an entry")
    if digests.of_bytes(document) != raw["result"]:
        raise ValueError("its result has another digest")
    result = ActionResult.from_document(document)
    result.know(raw["result"])
    files = _files(raw["files"])
    if files[0][:2] != (OUTPUT, result.output):
        raise ValueError("it does not begin with the output")
    named = [digests.of_bytes(asked[0])] if asked else [file.digest for file in files if file.role == KEY]
    if named != [result.key_document]:
        raise ValueError("its key document has another digest")
    return Entry(result, files, asked[0] if asked else b"", raw["bare"])


def _files(raw: Any) -> tuple[File, ...]:
    if not isinstance(raw, list) or not raw:
        raise ValueError("an entry names blobs")
    files = []
    for row in raw:
        if not isinstance(row, list) or [*map(type, row)] != [str, str, int]:
            raise ValueError("a blob has a role, a digest and a size")
        file = File(*row)
        if file.role not in _ROLES or not is_digest(file.digest) or not 0 <= file.size < _MOST_BYTES:
            raise ValueError("it names what cannot be a blob")
        files.append(file)
    return tuple(files)


def _is_typed(raw: Mapping[str, Any]) -> bool:
    metrics = raw["metrics"]
    return (
        _is_blob(raw["output"])
        and _is_blob(raw["key_document"])
        and (raw["log"] is None or _is_blob(raw["log"]))
        and _is_text(raw["line"])
        and _is_number(raw["seconds"])
        and _are_pairs(raw["previews"], _is_text, _is_blob)
        and ("calls" not in raw or (raw["calls"] != [] and _are_pairs(raw["calls"], _is_blob, _is_blob)))
        and isinstance(metrics, dict)
        and _are_pairs([*metrics.values()], _is_number, _is_text)
    )


def _are_pairs(value: object, first: Callable[[object], bool], second: Callable[[object], bool]) -> bool:
    return isinstance(value, list) and all(
        isinstance(pair, list) and len(pair) == 2 and first(pair[0]) and second(pair[1]) for pair in value
    )


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _is_blob(value: object) -> bool:
    return isinstance(value, str) and is_digest(value)


def _is_number(value: object) -> bool:
    # Of a whole number beyond all floats `math.isfinite` knows no answer.
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max
