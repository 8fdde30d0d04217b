"""What this machine remembers of each recipe: when each node was last made, from what, and how long that took."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import field, replace
from pathlib import Path
from typing import Any

from dextera_build import digest as digests
from dextera_build.errors import StoreError
from dextera_build.plain import dataclass
from dextera_build.store import failpoints, files
from dextera_build.store.store import Store

_FORM = 1
_NUMBERS = {int, float}
_ROWS = 1000
"""So many nodes are spelled at a time."""
_WRITING = re.compile(rb'{"writing": "([0-9a-f]+)"')
"""How the file of all nodes begins: which writing of it this is. What stands beside it says to which it belongs."""


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
    """

    def __init__(self, store: Store, recipe: str, project: str = "") -> None:
        name = digests.of_value([project, recipe])[:16]
        stem = "".join(c if c.isalnum() else "-" for c in recipe)[-40:]
        self._path = store.local / "history" / f"{stem}-{name}.json"
        self._project = project
        self._more = self._path.with_suffix(".more.json")
        self._fresh: dict[str, Entry] = {}
        self._entries: dict[str, Entry] | None = None
        self._dirty = False
        self.lean = False
        """Write what is new beside what is known, so that a small build need not read all of it."""

    def get(self, address: str) -> Entry | None:
        """The entry of a node, or None where it was never made here."""
        return self._load().get(address)

    def all(self) -> dict[str, Entry]:
        """Every entry."""
        return dict(self._load())

    def note(self, address: str, entry: Entry) -> None:
        """Remember a node; one that still has its key stays with the run that gave it that."""
        if self.lean and self._entries is None:
            self._fresh[address] = _with_usage(entry, self._fresh.get(address))
            return
        known = self._load().get(address)
        if known is not None and known.key == entry.key and known.key_document == entry.key_document:
            if not entry.usage:
                return
            entry = replace(known, usage=entry.usage)
        self._load()[address] = _with_usage(entry, known)
        self._dirty = True

    def peak_gb(self, address: str) -> float | None:
        """Most memory that the last run of a node took [GiB], where that is known."""
        known = self.get(address)
        peak = known.usage.get("memory_bytes") if known else None
        return peak / 2**30 if peak else None

    def save(self) -> None:
        """Write it down, all or nothing; a store that cannot be written keeps the old one."""
        if self._fresh:
            writing = self._writing()
            self._write(self._more, {"beside": writing}, _over(self._read(self._more, writing), self._fresh))
        elif self._dirty and self._write(self._path, {"writing": os.urandom(8).hex()}, self._load()):
            self._dirty = False
            failpoints.reach("history.saved")
            self._more.unlink(missing_ok=True)

    def _load(self) -> dict[str, Entry]:
        if self._entries is None:
            more = self._read(self._more, self._writing())
            self._entries = _over(_over(self._read(self._path), more), self._fresh)
            self._dirty = self._dirty or bool(more)
        return self._entries

    def _writing(self) -> str:
        with suppress(OSError), self._path.open("rb") as file:
            found = _WRITING.match(file.read(64))
            return found[1].decode() if found else ""
        return ""

    def _read(self, path: Path, beside: str = "") -> dict[str, Entry]:
        """The entries of a file; none where it stood beside another writing, which holds them already."""
        with suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
            stored = digests.plain(files.read(str(path)))
            if stored["form"] == _FORM and stored.get("beside", "") == beside:
                return {address: _entry(row) for address, row in stored["nodes"].items()}
        return {}

    def _write(self, path: Path, mark: Mapping[str, str], entries: Mapping[str, Entry]) -> bool:
        head = json.dumps({**mark, "form": _FORM, "project": self._project})[:-1]
        try:
            with files.new_file(str(path), 0o644) as target:
                files.write_all(target, f'{head}, "nodes": {{'.encode())
                names = list(entries)
                for start in range(0, len(names), _ROWS):  # as one text it would take as much memory as the graph
                    rows = {name: _row(entries[name]) for name in names[start : start + _ROWS]}
                    files.write_all(target, f"{', ' if start else ''}{json.dumps(rows)[1:-1]}".encode())
                files.write_all(target, b"}}")
        except StoreError:
            return False
        return True


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


def _over(old: Mapping[str, Entry], new: Mapping[str, Entry]) -> dict[str, Entry]:
    return {**old, **{address: _with_usage(entry, old.get(address)) for address, entry in new.items()}}


def _with_usage(entry: Entry, old: Entry | None) -> Entry:
    """What a node used when it ran last is known still where it did not run this time."""
    return entry if entry.usage or old is None or not old.usage else replace(entry, usage=old.usage)
