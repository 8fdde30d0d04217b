"""The action cache: key -> what the run of that key made; `entry.py` says how an entry is spelled.

A *bare* entry has bytes that are absent by design: it names only blobs that are there, among them the headers and the
key document.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from dextera_build.errors import StoreError
from dextera_build.store import blobs as cas
from dextera_build.store import entry as entries
from dextera_build.store import failpoints, files
from dextera_build.store.blobs import Blobs, MissingBlob
from dextera_build.store.entry import ActionResult, Entry, File
from dextera_build.store.references import UNREADABLE, References

_NONE: Mapping[str, int] = {}


@dataclass(frozen=True, slots=True)
class Found:
    """What the store knows of a key."""

    result: ActionResult
    is_whole: bool
    """Whether every blob that the result names is there; if not, the headers of its output are."""


class Actions:
    """Results below one folder.

    Args:
        root: The folder; made when the first result comes.
        blobs: The blobs that results refer to.
    """

    def __init__(self, root: Path, blobs: Blobs) -> None:
        self.root = root
        self._base = f"{root}/"
        self._workshop = f"{root}/{files.TEMPORARY}"
        self._blobs = blobs
        self.references = References(blobs)

    def get(self, key: str) -> ActionResult | None:
        """The result of `key`; None if there is none, or a blob that it needs is gone or has another size."""
        found = self.find(key)
        return found.result if found is not None and found.is_whole else None

    def has(self, key: str) -> bool:
        """Whether there is an entry of `key`, which may be damaged; the quickest question."""
        return os.access(self._file(key), os.F_OK)

    def known(self, key: str) -> ActionResult | None:
        """The result of `key`, with or without its bytes; None if there is none."""
        entry = self.entry(key)
        return entry.result if entry is not None else None

    def find(self, key: str) -> Found | None:
        """The result of `key`, which may be bare; None if there is none, or the headers of its output are gone."""
        stamped = self._stamped(key)
        if stamped is None:
            return None
        entry, stamp = stamped
        there = [file for file in entry.files if self._is_there(file)]
        if not self._stays(key, stamp):
            return None
        if entry.is_bare and self._completes(key, entry):
            return Found(entry.result, True)
        is_whole = not entry.is_bare and len(there) == len(entry.files)
        if not is_whole and self.references.headers(entry.result.output) is None:
            return None
        return Found(entry.result, is_whole)

    def put(
        self,
        key: str,
        result: ActionResult,
        beside: Iterable[str] = (),
        sizes: Mapping[str, int] = _NONE,
        document: bytes = b"",
        *,
        may_lack: bool = False,
    ) -> bool:
        """Store the result of `key`, whose blobs are stored already; returns False if the entry is bare.

        Args:
            key: Digest of the key document.
            result: The result.
            beside: Further blobs that stay as long as the result does.
            sizes: Blobs that were stored a moment ago -> size [bytes]; the others are looked for.
            document: The key document; b"": the store holds it already.
            may_lack: Write a bare entry if bytes are absent but the headers of the output are there.

        Raises:
            MissingBlob: The result refers to something that is not in the store.
            StoreError: The disk is full, or the store cannot be written.
            ValueError: A number is not finite.
        """
        try:
            self._keep_calls(result)
            entry = self.made(result, beside, sizes, document)
        except MissingBlob:
            if not may_lack:
                raise
            entry = self._bare(key, result, beside, document)
        if not entry.is_bare or entry != self.entry(key):
            failpoints.reach("result.blobs")
            files.write(self._file(key), entry.spell(), workshop=self._workshop)
            failpoints.reach("result.published")
        return not entry.is_bare

    def made(
        self,
        result: ActionResult,
        beside: Iterable[str] = (),
        sizes: Mapping[str, int] = _NONE,
        document: bytes = b"",
    ) -> Entry:
        """The entry of a result, all of whose blobs are stored; the entry itself is not. See `put`.

        Raises:
            MissingBlob: The result refers to something that is not in the store.
        """
        named, document = self._asked(result.key_document, document, sizes)
        needs = [*self._needs(result, sizes), *named, *self._sized(entries.BESIDE, beside)]
        return Entry(result, tuple(needs), document)

    def verify(self, key: str) -> bool:
        """Whether `key` has a result all of whose blobs are whole; every blob is read, damaged ones are set aside."""
        entry = self.entry(key)
        if entry is None:
            return False
        whole = [self._blobs.verify(file.digest) for file in entry.files]
        return all(whole) and not entry.is_bare

    def files(self, key: str) -> list[Path]:
        """The files of the entry and of every blob that it needs; empty if there is no entry."""
        entry = self.entry(key)
        if entry is None:
            return []
        return [Path(self._file(key)), *(self._blobs.path(file.digest) for file in entry.files)]

    def keys(self) -> Iterator[str]:
        """Every key that has an entry."""
        yield from (key for key, _, _ in cas.listing(self.root))

    def entry(self, key: str) -> Entry | None:
        """What lies under `key`, or None; no use is noted."""
        found = self._stamped(key)
        return found[0] if found is not None else None

    def document(self, key: str) -> bytes | None:
        """The key document that the entry of `key` holds, None where it is a blob or there is no entry."""
        entry = self.entry(key)
        return entry.document or None if entry is not None else None

    def calls(self, key: str) -> bool:
        """Whether the result of `key` came of recorded calls."""
        found = self.known(key)
        return found is not None and bool(found.calls)

    def outline(self, key: str) -> tuple[str, frozenset[str]] | None:
        """(output, digests that it refers to) of `key`, whether these blobs are there or not; None without an entry."""
        entry = self.entry(key)
        if entry is None:
            return None
        return entry.result.output, frozenset(file.digest for file in entry.files if file.role == entries.CLOSURE)

    def _is_there(self, file: File) -> bool:
        size = self._blobs.size(file.digest)
        if size is not None and size != file.size:
            self._blobs.verify(file.digest)
        return size == file.size

    def _completes(self, key: str, entry: Entry) -> bool:
        """Whether bytes that were absent have come since; if so, the entry is rewritten."""
        try:
            self.put(key, entry.result, [file.digest for file in entry.files if file.role == entries.BESIDE])
        except (*UNREADABLE, StoreError):
            return False
        return True

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

    def _stamped(self, key: str) -> tuple[Entry, float] | None:
        """The entry of `key` and its last use; one that is damaged or belongs under another key is dropped."""
        path = self._file(key)
        try:
            data, stamp = files.read_stamped(path)
        except OSError:
            return None
        with suppress(ValueError):
            entry = entries.read(data)
            if entry.key == key:
                return entry, stamp
        with suppress(OSError):
            failpoints.reach("result.damaged")
            os.unlink(path)
        return None

    def _keep_calls(self, result: ActionResult) -> None:
        """Write the entries of recorded calls that came with a result from another store."""
        for key, digest in result.calls:
            if self.entry(key) is None:
                called = ActionResult.from_document(self._blobs.get(digest))
                if called.key_document != key or not called.is_record:
                    raise ValueError("a call does not have the digest that is its key")
                self.put(key, called)

    def _bare(self, key: str, result: ActionResult, beside: Iterable[str], document: bytes) -> Entry:
        """The entry of a result bytes of which are absent.

        Raises:
            MissingBlob: A header of its output or the key document is not in the store.
        """
        headers = self.references.headers(result.output)
        if headers is None:
            raise MissingBlob(result.output)
        named, document = self._asked(result.key_document, document)
        needs = [*self._sized(entries.OUTPUT, headers[:1]), *self._sized(entries.CLOSURE, headers[1:])]
        needs += [*named, *self._sized(entries.BESIDE, beside)]
        # A collection takes what no entry names: bytes that happen to be there stay.
        known = self.entry(key)
        held = known.files if known is not None else ()
        needs += [file for file in held if file.role != entries.KEY and file not in needs and self._is_there(file)]
        return Entry(result, tuple(needs), document, is_bare=True)

    def _asked(self, digest: str, document: bytes, sizes: Mapping[str, int] = _NONE) -> tuple[Iterable[File], bytes]:
        """The key document as a blob, where it is long or the store has no other, or as what the entry holds."""
        document = document or self.document(digest) or b""
        if document and len(document) <= entries.MOST_DOCUMENT:
            return (), document
        if document:
            self._blobs.put(document)
        return self._sized(entries.KEY, [digest], sizes), b""

    def _needs(self, result: ActionResult, sizes: Mapping[str, int]) -> Iterator[File]:
        yield from self._sized(entries.OUTPUT, [result.output], sizes)
        yield from self._sized(entries.CLOSURE, self.references.below(result.output), sizes)
        yield from self._sized(entries.PREVIEW, [digest for _, digest in result.previews], sizes)
        yield from self._sized(entries.LOG, [result.log] if result.log else (), sizes)
        for key, digest in result.calls:
            called = ActionResult.from_document(self._blobs.get(digest))
            yield from self._sized(entries.CALL, [key])
            yield from self._sized(
                entries.ANSWER, dict.fromkeys((digest, called.output, *self.references.below(called.output)))
            )

    def _sized(self, role: str, named: Iterable[str], sizes: Mapping[str, int] = _NONE) -> Iterator[File]:
        for digest in named:
            size = sizes.get(digest)
            if size is None:
                size = self._blobs.size(digest)
            if size is None:
                raise MissingBlob(digest)
            yield File(role, digest, size)

    def _file(self, key: str) -> str:
        return f"{self._base}{key[:2]}/{key[2:]}"
