"""What this machine remembers of each recipe: when each node was last made, from what, and how long that took."""

from __future__ import annotations

import json
import marshal
import os
from collections.abc import Iterable, Iterator, Mapping, MutableMapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any, BinaryIO

from dextera_build import digest as digests
from dextera_build.errors import StoreError
from dextera_build.store import failpoints, files, signature
from dextera_build.store.cas import is_digest
from dextera_build.store.store import Store

_FORM = 1
_NUMBERS = {int, float}
_CHUNK = 1 << 16
_MOST_HELD = 10_000
"""Rows in memory: 2 MB."""
_LENGTH = 20
"""Bits of the length of a row."""
_LONGEST = (1 << _LENGTH) - 1
_OPEN, _CLOSE = b'"nodes": {\n', b"}}"
"""Between them stands a row a line."""


@dataclass(frozen=True, slots=True)
class Entry:
    """The last time that a node was brought up to date."""

    key: str
    key_document: str
    """Digest of the key document."""
    run: str
    """Id of the run in which it got this key."""
    seconds: float
    """How long the rule ran [s]."""
    time: float
    """Seconds since the epoch."""
    usage: Mapping[str, float] = field(default_factory=dict)
    """What its last run on this machine used; see `usage.Usage`."""


class History:
    """Node address -> entry, for one recipe of one project.

    Args:
        store: Holds the file, in its machine-local part.
        recipe: Address of the recipe.
        project: Folder of the project; two projects may share a store and have recipes of one name.
        variant: What tells the request from the recipe's own; "" for that.
    """

    def __init__(self, store: Store, recipe: str, project: str = "", variant: str = "") -> None:
        name = digests.of_value([project, recipe, variant] if variant else [project, recipe])[:16]
        self._base = History(store, recipe, project) if variant else None
        stem = "".join(c if c.isalnum() else "-" for c in recipe)[-40:]
        self._path = store.local / "history" / f"{stem}-{name}.json"
        self._project = project
        self._locks, self._lock = store.locks, digests.of_bytes(f"history {name}".encode())
        self._entries: _Packed | None = None
        self._state: signature.Signature | None = None
        """Of the file that the entries come from."""
        self._noted: set[str] = set()
        """Addresses of entries that are not written down."""

    def get(self, address: str) -> Entry | None:
        """The entry of a node, else that of the recipe's own request; None where it was never made here."""
        return self._load().entry(address) or (self._base.get(address) if self._base else None)

    def all(self) -> dict[str, Entry]:
        """Every entry of this request."""
        return dict(self._load())

    def note(self, address: str, entry: Entry) -> None:
        """Remember a node; one that still has its key stays with the run that gave it that."""
        known = self._load().entry(address)
        if known is not None and known.key == entry.key and known.key_document == entry.key_document:
            if not entry.usage:
                return
            entry = replace(known, usage=entry.usage)
        self._load()[address] = _with_usage(entry, known)
        self._noted.add(address)

    def peak_gb(self, address: str) -> float | None:
        """Most memory that the last run of a node took [GiB], where that is known."""
        known = self.get(address)
        peak = known.usage.get("memory_bytes") if known else None
        return peak / 2**30 if peak else None

    def usage(self, address: str) -> Mapping[str, float]:
        """What the last run of a node used."""
        known = self.get(address)
        return known.usage if known else {}

    def save(self) -> None:
        """Write down what was noted, beside what other builds wrote meanwhile; all or nothing.

        A store that cannot be written keeps the old file.
        """
        if not self._noted:
            return
        with self._locks.hold(self._lock):
            entries = self._load()
            if signature.look(str(self._path)) != self._state:
                own, entries = entries, self._read()
                entries.update((address, own[address]) for address in self._noted)
            if self._write(entries):
                self._entries, self._state = entries, signature.look(str(self._path))
                self._noted.clear()
                failpoints.reach("history.saved")

    def _load(self) -> _Packed:
        if self._entries is None:
            self._entries = self._read()
        return self._entries

    def _read(self) -> _Packed:
        self._state = signature.look(str(self._path))
        with suppress(OSError, ValueError, KeyError, TypeError, AttributeError), self._path.open("rb") as file:
            head = file.readline()
            stored = digests.plain(head + _CLOSE if head.endswith(_OPEN) else head)
            if stored["form"] == _FORM:
                found = _Packed()
                for address, row in chain(stored["nodes"].items(), _lines(file) if head.endswith(_OPEN) else ()):
                    found[address] = _entry(row)
                return found
        return _Packed()

    def _write(self, entries: Mapping[str, Entry]) -> bool:
        head = json.dumps({"form": _FORM, "project": self._project})[:-1]
        try:
            with files.new_file(str(self._path), 0o644) as target:
                files.write_all(target, f'{head}, "nodes": {{\n'.encode())
                text, comma = "", ""
                for address, entry in entries.items():
                    text += f"{comma}{json.dumps(address)}: {json.dumps(_row(entry))}"
                    comma = ",\n"
                    if len(text) > _CHUNK:  # as one text it would take as much memory as the graph
                        files.write_all(target, text.encode())
                        text = ""
                files.write_all(target, text.encode() + b"\n" + _CLOSE)
        except StoreError:
            return False
        return True


class _Packed(MutableMapping[str, Entry]):
    """Entries by address: those of late in 150 bytes each, where as objects they take 600; the others lie in a file."""

    def __init__(self) -> None:
        self._rows: dict[str, bytes | int] = {}
        """Address -> row, or where it lies among those laid aside: place, then length in the lowest bits."""
        self._loose: list[str] = []
        """Addresses of rows that were not laid aside."""
        self._aside: BinaryIO | None = None
        self._words: list[Any] = []
        """Runs, and names of what was used, which many entries share."""
        self._places: dict[object, int] = {}

    def __getitem__(self, address: str) -> Entry:
        kept = self._rows[address]
        row = os.pread(self._file().fileno(), kept & _LONGEST, kept >> _LENGTH) if isinstance(kept, int) else kept
        key, document, run, seconds, time, names, *values = marshal.loads(row)
        key, words = _long(key), self._words
        usage = dict(zip(words[names], values, strict=True))
        return Entry(key, key if document is None else _long(document), words[run], seconds, time, usage)

    def __setitem__(self, address: str, entry: Entry) -> None:
        document = None if entry.key_document == entry.key else _short(entry.key_document)
        run, names = self._place(entry.run), self._place(tuple(entry.usage))
        row = (_short(entry.key), document, run, entry.seconds, entry.time, names, *entry.usage.values())
        self._rows[address] = bytes(memoryview(marshal.dumps(row)))  # see `yaml_node.Node.pack`
        self._loose.append(address)
        if len(self._loose) > _MOST_HELD:
            self._lay_aside()

    def _lay_aside(self) -> None:
        """Let rows lie in a file without a name: those of a hundred thousand nodes take 14 MB."""
        rows = {address: row for address in self._loose if isinstance(row := self._rows.get(address), bytes)}
        self._loose = []
        with suppress(OSError):  # where there is no room for it they stay in memory
            file = self._file()
            place = file.seek(0, os.SEEK_END)
            files.write_all(file.fileno(), b"".join(rows.values()))
            for address, row in rows.items():
                if len(row) <= _LONGEST:
                    self._rows[address] = place << _LENGTH | len(row)
                place += len(row)

    def _file(self) -> BinaryIO:
        if self._aside is None:
            from tempfile import TemporaryFile

            self._aside = TemporaryFile(buffering=0)  # noqa: SIM115 - as long as the build
        return self._aside

    def entry(self, address: str) -> Entry | None:
        """The entry of an address; quicker than `get` where there is none."""
        return self[address] if address in self._rows else None

    def __delitem__(self, address: str) -> None:
        del self._rows[address]

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)

    def _place(self, word: object) -> int:
        place = self._places.setdefault(word, len(self._words))
        if place == len(self._words):
            self._words.append(word)
        return place


def _short(digest: str) -> bytes | str:
    return bytes.fromhex(digest) if is_digest(digest) else digest


def _long(digest: bytes | str) -> str:
    return digest.hex() if isinstance(digest, bytes) else digest


def _lines(file: Iterable[bytes]) -> Iterator[tuple[str, list[Any]]]:
    """The rows of a history, a line each.

    Raises:
        ValueError: There is another thing on a line, or the end is missing.
    """
    for line in file:
        if line == _CLOSE:
            return
        if line != b"\n":
            yield from digests.plain(b"{" + line.rstrip().removesuffix(b",") + b"}").items()
    raise ValueError("the end is missing")


def _entry(row: list[Any]) -> Entry:
    """The entry of a row.

    Raises:
        TypeError, AttributeError: It is none.
    """
    entry = Entry(*row)
    numbers = (entry.seconds, entry.time, *entry.usage.values())
    if {*map(type, row[:3])} != {str} or not {*map(type, numbers)} <= _NUMBERS:
        raise TypeError("not a row of a history")
    return entry


def _row(entry: Entry) -> list[object]:
    return [entry.key, entry.key_document, entry.run, entry.seconds, entry.time, entry.usage]


def _with_usage(entry: Entry, old: Entry | None) -> Entry:
    """What a node used when it ran last is known still where it did not run this time."""
    return entry if entry.usage or old is None or not old.usage else replace(entry, usage=old.usage)
