"""What this machine remembers of each recipe: when each node was last made, from what, and how long that took."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace

from dextera_build import digest as digests
from dextera_build.errors import StoreError
from dextera_build.store import files
from dextera_build.store.store import Store

_FORM = 1


@dataclass(frozen=True)
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
        self._entries: dict[str, Entry] | None = None
        self._dirty = False

    def get(self, address: str) -> Entry | None:
        """The entry of a node, or None where it was never made here."""
        return self._load().get(address)

    def all(self) -> dict[str, Entry]:
        """Every entry."""
        return dict(self._load())

    def note(self, address: str, entry: Entry) -> None:
        """Remember a node; one that still has its key stays with the run that gave it that."""
        known = self._load().get(address)
        if known is not None and known.key == entry.key and known.key_document == entry.key_document:
            if not entry.usage:
                return
            entry = replace(known, usage=entry.usage)
        elif known is not None and not entry.usage:
            entry = replace(entry, usage=known.usage)
        self._load()[address] = entry
        self._dirty = True

    def peak_gb(self, address: str) -> float | None:
        """Most memory that the last run of a node took [GiB], where that is known."""
        known = self.get(address)
        peak = known.usage.get("memory_bytes") if known else None
        return peak / 2**30 if peak else None

    def save(self) -> None:
        """Write it down, all or nothing; a store that cannot be written keeps the old one."""
        if self._dirty:
            rows = {address: list(vars(entry).values()) for address, entry in self._load().items()}
            with suppress(StoreError):
                files.write(
                    str(self._path),
                    json.dumps({"form": _FORM, "project": self._project, "nodes": rows}).encode(),
                    0o644,
                )
                self._dirty = False

    def _load(self) -> dict[str, Entry]:
        if self._entries is None:
            self._entries = {}
            with suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
                stored = json.loads(files.read(str(self._path)))
                if stored["form"] == _FORM:
                    self._entries = {address: Entry(*row) for address, row in stored["nodes"].items()}
        return self._entries
