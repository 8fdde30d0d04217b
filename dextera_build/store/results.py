"""The action cache: key -> result; `entry.py` describes the format of an entry."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
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


@dataclass(frozen=True, slots=True)
class Found:
    """A result found in a store."""

    result: ActionResult
    is_whole: bool
    """Whether every blob that the result names is present; the headers of its output always are."""


class Actions:
    """Results below one folder.

    Args:
        root: The folder; created with the first result.
        blobs: The blobs that results refer to.
    """

    def __init__(self, root: Path, blobs: Blobs) -> None:
        self.root = root
        self._base = f"{root}/"
        self._workshop = f"{root}/{files.TEMPORARY}"
        self._blobs = blobs
        self.references = References(blobs)

    def get(self, key: str) -> ActionResult | None:
        """The result of `key`; None if there is none, or a blob that it needs is missing or has the wrong size."""
        found = self.find(key)
        return found.result if found is not None and found.is_whole else None

    def known(self, key: str) -> ActionResult | None:
        """The result of `key`, with or without its bytes; None if there is none."""
        entry = self.entry(key)
        return entry.result if entry is not None else None

    def find(self, key: str) -> Found | None:
        """The result of `key`, which may be bare; None if there is none, or a header of its output is missing."""
        stamped = self._stamped(key)
        if stamped is None:
            return None
        entry, stamp = stamped
        absent = [file for file in entry.files if not self._is_there(file)]
        if any(file.role in entries.HEADERS for file in absent) or not self._stays(key, stamp):
            return None
        if entry.is_bare and not absent:  # the bytes arrived since, so their sizes are known
            with suppress(StoreError, *UNREADABLE):
                self.put(key, entry.result, [file.digest for file in entry.files if file.role == entries.BESIDE])
        return Found(entry.result, not absent)

    def put(self, key: str, result: ActionResult, beside: Iterable[str] = (), *, may_lack: bool = False) -> bool:
        """Store the result of `key`, whose blobs are already stored; return False if the entry is bare.

        Args:
            key: Digest of the key document.
            result: The result.
            beside: Further blobs that are kept as long as the result.
            may_lack: Write a bare entry if bytes are absent but the headers of the output are present.

        Raises:
            MissingBlob: A blob that the result refers to is not in the store.
            StoreError: The disk is full, or the store cannot be written.
            ValueError: A number is not finite, or a named call is not a recorded call.
        """
        entry = self.made(result, beside, may_lack=may_lack)
        for call, digest in () if entry.is_bare else result.calls:
            if self.entry(call) is None:  # the call came with a result from another store
                self.put(call, ActionResult.from_document(self._blobs.get(digest)))
        if not entry.is_bare or entry != self.entry(key):
            failpoints.reach("result.blobs")
            files.write(self._file(key), entry.spell(), workshop=self._workshop)
            failpoints.reach("result.published")
        return not entry.is_bare

    def made(self, result: ActionResult, beside: Iterable[str] = (), *, may_lack: bool = False) -> Entry:
        """Make the entry of a result whose blobs are stored, without storing the entry; see `put`.

        Raises:
            MissingBlob: A blob that the result refers to is not in the store.
        """
        roles = {result.output: entries.OUTPUT, result.key_document: entries.KEY}
        for digest, is_header in self.references.below(result.output).items():
            roles.setdefault(digest, entries.HEADER if is_header else entries.BLOB)
        more = (*(blob for _, blob in result.previews), *([result.log] if result.log else ()), *beside)
        for digest in (*more, *self._called(result, may_lack=may_lack)):
            roles.setdefault(digest, entries.BESIDE)
        named = tuple(File(role, digest, self._blobs.size(digest)) for digest, role in roles.items())
        for file in named:
            if file.size is None and not (may_lack and file.role not in entries.HEADERS):
                raise MissingBlob(file.digest)
        return Entry(result, named)

    def keys(self) -> Iterator[str]:
        """Every key that has an entry."""
        yield from (key for key, _, _ in cas.listing(self.root))

    def entry(self, key: str) -> Entry | None:
        """The entry of `key`, or None; this does not count as a use."""
        found = self._stamped(key)
        return found[0] if found is not None else None

    def _is_there(self, file: File) -> bool:
        size = self._blobs.size(file.digest)
        if file.size is not None and size is not None and size != file.size:
            self._blobs.verify(file.digest)
            return False
        return size is not None

    def _stays(self, key: str, stamp: float) -> bool:
        path = self._file(key)
        try:
            return self._blobs.use.note(path, stamp)
        except PermissionError:
            # Another user owns the file; only a new copy of our own gets a new time stamp.
            with suppress(OSError, StoreError):
                files.write(path, files.read(path), workshop=self._workshop)
                return True
            return False

    def _stamped(self, key: str) -> tuple[Entry, float] | None:
        """The entry of `key` and its last use; a damaged entry, or one with another key, is deleted."""
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

    def _called(self, result: ActionResult, *, may_lack: bool) -> Iterator[str]:
        """The blobs of the recorded calls of a result."""
        for key, digest in result.calls:
            yield from (key, digest)
            try:
                called = ActionResult.from_document(self._blobs.get(digest))
                if called.key_document != key or not called.is_record:
                    raise ValueError("a call does not have the digest that is its key")
                yield from (called.output, *self.references.below(called.output))
            except MissingBlob:
                if not may_lack:
                    raise

    def _file(self, key: str) -> str:
        return f"{self._base}{key[:2]}/{key[2:]}"
