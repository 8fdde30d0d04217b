"""The action cache: key -> what the run of that key made.

An entry is an `ActionResult` message of the Remote Execution API (build.bazel.remote.execution.v2), so that existing
cache servers hold and check it. Its `output_files` name every blob that the entry needs to be of use: the output's
header and all that it refers to, previews, log, key document, and `result.json`; some it holds itself (`inside.py`).

A *bare* entry is one whose bytes are absent by design: it names only what is there (headers, key document,
`result.json`) and, so that nobody takes it for whole, a blob that nobody can have.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dextera_build import digest as digests
from dextera_build.errors import StoreError
from dextera_build.store import failpoints, files, inside
from dextera_build.store.cas import Blobs, MissingBlob, entries
from dextera_build.store.presence import Presence
from dextera_build.store.reapi import OutputFile, decode, encode
from dextera_build.store.references import UNREADABLE, References
from dextera_build.store.streams import Recent

_NONE: Mapping[str, int] = {}
ABSENT = OutputFile("absent", "0" * 64, 1)
"""Stands in a bare entry for all bytes that are not there."""


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
    """Digest of what it printed, None where it printed nothing."""
    key_document: str
    """Digest of the key document."""
    calls: tuple[tuple[str, str], ...] = ()
    """(key, digest of the `result.json`) of recorded calls that the run made."""
    _digest: str = field(default="", init=False, repr=False, compare=False)

    @property
    def document(self) -> bytes:
        """This result as canonical JSON; the content of `result.json`.

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
        """Digest of `document`; spelled once."""
        if not self._digest:
            self.know(digests.of_bytes(self.document))
        return self._digest

    def know(self, digest: str) -> None:
        """Its digest is known already, and need not be found by spelling it."""
        object.__setattr__(self, "_digest", digest)

    @property
    def called(self) -> tuple[Mapping[str, str], ...]:
        """The recorded calls, as events and records name them."""
        return tuple({"call": key} for key, _ in self.calls)

    @classmethod
    def from_document(cls, data: bytes) -> ActionResult:
        """The result that `document` described."""
        raw: dict[str, Any] = digests.plain(data)
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
class Found:
    """What the store knows of a key."""

    result: ActionResult
    is_whole: bool
    """Whether all that the result names is there; else it is bare, and the headers of its output are."""


class Actions:
    """Results below one folder.

    Args:
        root: The folder; made when the first result comes.
        blobs: Where everything lies that results refer to.
        recent: May hold some of it in memory.
    """

    def __init__(self, root: Path, blobs: Blobs, recent: Recent) -> None:
        self.root = root
        self._base = f"{root}/"
        self._workshop = f"{root}/{files.TEMPORARY}"
        self._blobs = blobs
        self.presence: Presence | None = None
        """When set, every file that a result stands on is noted there."""
        self.references = References(blobs, recent)

    def get(self, key: str) -> ActionResult | None:
        """The result of `key`, or None where there is none or a blob that it needs is gone or has another size."""
        found = self.find(key)
        return found.result if found is not None and found.is_whole else None

    def has(self, key: str) -> bool:
        """Whether there is an entry of `key`, which may be damaged; the quickest question."""
        return os.access(self._file(key), os.F_OK)

    def known(self, key: str) -> ActionResult | None:
        """The result of `key` whether its bytes are there or not, or None where there is none."""
        outputs = self._entry(key)
        return self._result(outputs) if outputs is not None else None

    def find(self, key: str) -> Found | None:
        """The result of `key`, which may be bare, or None where there is none or not even its headers are there."""
        stamped = self._stamped(key)
        if stamped is None:
            return None
        outputs, stamp = stamped
        needs = inside.blobs(outputs)
        there = [file for file in needs if self._is_there(file)]
        result = self._result(outputs)
        if result is None or not self._stays(key, stamp):
            return None
        is_whole = len(there) == len(needs)
        if not is_whole and ABSENT in outputs and self._completes(key, result):
            return Found(result, True)
        if not is_whole and self.references.headers(result.output) is None:
            return None
        self.rely(key, there)
        return Found(result, is_whole)

    def put(
        self,
        key: str,
        result: ActionResult,
        beside: Iterable[str] = (),
        sizes: Mapping[str, int] = _NONE,
        document: bytes = b"",
    ) -> str:
        """Store the result of `key` after all that it needs, and return the digest of its `result.json`.

        Args:
            key: Digest of the key document.
            result: The result.
            beside: Further blobs that stay as long as the result does.
            sizes: Blobs that were stored a moment ago -> size [bytes]; the others are looked for.
            document: The key document, which the entry shall hold unless it is long; b"": the store holds it already.

        Raises:
            MissingBlob: The result refers to something that is not in the store.
            StoreError: The disk is full, or the store cannot be written.
            ValueError: A number is not finite.
        """
        self.rely(key, self.write(key, result, beside, sizes, document))
        return result.digest

    def write(
        self,
        key: str,
        result: ActionResult,
        beside: Iterable[str] = (),
        sizes: Mapping[str, int] = _NONE,
        document: bytes = b"",
    ) -> list[OutputFile]:
        """Store the result of `key` as `put` does, and return the blobs that it needs; for who relies on nothing."""
        self._keep_calls(result)
        message, outputs = self.spell(result, beside, sizes, document)
        self.enter(key, message)
        return inside.blobs(outputs)

    def enter(self, key: str, message: bytes) -> None:
        """Store the entry of `key` as `spell` gave it.

        Raises:
            StoreError: The disk is full, or the store cannot be written.
        """
        failpoints.reach("result.blobs")
        files.write(self._file(key), message, workshop=self._workshop)
        failpoints.reach("result.published")

    def rely(self, key: str, outputs: Iterable[OutputFile]) -> None:
        """Note that a build stands on the result of `key`, which it has just found or made."""
        if self.presence is not None:
            self.presence.note(key, outputs)

    def spell(
        self,
        result: ActionResult,
        beside: Iterable[str] = (),
        sizes: Mapping[str, int] = _NONE,
        document: bytes = b"",
    ) -> tuple[bytes, list[OutputFile]]:
        """The entry of a result, and what it names; all that it needs is stored, the entry is not. See `put`.

        Raises:
            MissingBlob: The result refers to something that is not in the store.
        """
        asked = self._asked(result.key_document, document, sizes)
        outputs = [*self._needs(result, asked, sizes), *self._beside(beside), inside.last(result, asked, self._blobs)]
        return encode(outputs), outputs

    def _asked(self, digest: str, document: bytes, sizes: Mapping[str, int] = _NONE) -> OutputFile:
        """The key document; an entry that is written anew gives on what it held."""
        found = inside.asked(digest, document or self.document(digest) or b"", self._blobs)
        return found or self._sized(inside.KEY, digest, sizes)

    def _beside(self, digests_: Iterable[str]) -> list[OutputFile]:
        return [self._sized(f"answers/{digest}", digest) for digest in digests_]

    def put_bare(self, key: str, result: ActionResult, beside: Iterable[str] = ()) -> None:
        """Store the result of `key` although bytes that it names are absent; an entry that says so already stays.

        Raises:
            MissingBlob: A header of its output or the key document is not in the store.
            StoreError: The disk is full, or the store cannot be written.
        """
        headers = self.references.headers(result.output)
        if headers is None:
            raise MissingBlob(result.output)
        asked = self._asked(result.key_document, b"")
        named = [self._sized("output", result.output), asked]
        named += [self._sized(f"closure/{digest}", digest) for digest in headers[1:]]
        named += self._beside(beside)
        # What happens to be there is not given up: a collection would take what no entry names.
        held = [file for file in inside.blobs(self._entry(key) or ()) if self._is_there(file)]
        named += [file for file in held if file not in named and file.path not in (inside.KEY, inside.RESULT)]
        data = encode([*named, ABSENT, inside.last(result, asked, self._blobs)])
        with suppress(OSError):
            if files.read(self._file(key)) == data:
                return
        files.write(self._file(key), data, workshop=self._workshop)

    def verify(self, key: str) -> bool:
        """Whether `key` has a result all of whose blobs are whole; every blob is read, damaged ones are set aside."""
        outputs = self._entry(key)
        if outputs is None:
            return False
        whole = [self._blobs.verify(file.digest) for file in inside.blobs(outputs)]
        return all(whole)

    def files(self, key: str) -> list[Path]:
        """The entry and every blob that it needs, as files; empty where there is no entry."""
        outputs = self._entry(key)
        if outputs is None:
            return []
        return [Path(self._file(key)), *(self._blobs.path(file.digest) for file in inside.blobs(outputs))]

    def keys(self) -> Iterator[str]:
        """Every key that has an entry."""
        yield from (key for key, _ in entries(self.root))

    def message(self, key: str) -> tuple[bytes, list[OutputFile]] | None:
        """The entry of `key` as it would travel, and what it names, or None."""
        outputs = self._entry(key)
        return inside.travelling(outputs) if outputs is not None else None

    def document(self, key: str) -> bytes | None:
        """The key document that the entry of `key` holds, None where it is a blob or there is no entry."""
        held = (file.contents for file in self._entry(key) or () if (file.path, file.digest) == (inside.KEY, key))
        return next(held, b"") or None  # `decode` compared it with its digest

    def calls(self, key: str) -> bool:
        """Whether the result of `key` came of recorded calls."""
        found = self.known(key)
        return found is not None and bool(found.calls)

    def outline(self, key: str) -> tuple[str, frozenset[str]] | None:
        """(output, all that it refers to) of `key` by digest, whether the blobs are there or not, or None."""
        outputs = self._entry(key)
        if outputs is None:
            return None
        named = {file.path: file.digest for file in outputs}
        return named["output"], frozenset(digest for path, digest in named.items() if path.startswith("closure/"))

    def _is_there(self, file: OutputFile) -> bool:
        size = self._blobs.size(file.digest)
        if size is not None and size != file.size:
            self._blobs.verify(file.digest)
        return size == file.size

    def _completes(self, key: str, result: ActionResult) -> bool:
        """Whether bytes that were absent have come since; then the entry is written anew."""
        try:
            beside = [file.digest for file in self._entry(key) or () if file.path.startswith("answers/")]
            self.put(key, result, beside if not result.calls else ())
        except (*UNREADABLE, StoreError):
            return False
        return True

    def _entry(self, key: str) -> list[OutputFile] | None:
        found = self._stamped(key)
        return found[0] if found is not None else None

    def _stays(self, key: str, stamp: float) -> bool:
        path = self._file(key)
        try:
            return self._blobs.use.note(path, stamp)
        except PermissionError:
            # Another user's file, whose stamp only a copy of our own renews.
            with suppress(OSError, StoreError):
                files.write(path, files.read(path), workshop=self._workshop)
                return True
            return False

    def _stamped(self, key: str) -> tuple[list[OutputFile], float] | None:
        path = self._file(key)
        try:
            data, stamp = files.read_stamped(path)
        except OSError:
            return None
        try:
            outputs = decode(data)
            if (outputs[0].path, outputs[-1].path) != ("output", inside.RESULT):
                raise ValueError("a part of it is missing")
            return outputs, stamp
        except (ValueError, IndexError, KeyError):
            with suppress(OSError):
                failpoints.reach("result.damaged")
                os.unlink(path)
            return None

    def _result(self, outputs: list[OutputFile]) -> ActionResult | None:
        last = outputs[-1]
        try:
            return ActionResult.from_document(last.contents or self._blobs.get(last.digest))
        except (MissingBlob, ValueError, KeyError, TypeError):
            return None

    def _keep_calls(self, result: ActionResult) -> None:
        """Have an entry for every call that a result from elsewhere brings."""
        for key, digest in result.calls:
            if self._entry(key) is None:
                called = ActionResult.from_document(self._blobs.get(digest))
                if called.key_document != key or called.calls:
                    raise ValueError("a call does not have the digest that is its key")
                self.put(key, called)

    def _needs(self, result: ActionResult, asked: OutputFile, sizes: Mapping[str, int]) -> Iterator[OutputFile]:
        yield self._sized("output", result.output, sizes)
        for digest in self.references.below(result.output):
            yield self._sized(f"closure/{digest}", digest, sizes)
        for place, (_, digest) in enumerate(result.previews):
            yield self._sized(f"previews/{place}.png", digest, sizes)
        if result.log is not None:
            yield self._sized("log", result.log, sizes)
        yield asked
        for key, digest in result.calls:
            yield self._sized(f"calls/{key}", key)
            called = ActionResult.from_document(self._blobs.get(digest))
            for part in dict.fromkeys((digest, called.output, *self.references.below(called.output))):
                yield self._sized(f"answers/{part}", part)

    def _sized(self, path: str, digest: str, sizes: Mapping[str, int] = _NONE) -> OutputFile:
        size = sizes.get(digest)
        if size is None:
            size = self._blobs.size(digest)
        if size is None:
            raise MissingBlob(digest)
        return OutputFile(path, digest, size)

    def _file(self, key: str) -> str:
        return f"{self._base}{key[:2]}/{key[2:]}"
