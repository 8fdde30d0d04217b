"""The history of each recipe on this machine: when each node was last built, from what, and how long it took."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from dextera_build import digest as digests
from dextera_build.store import failpoints
from dextera_build.store.state import State
from dextera_build.store.store import Store

_KIND = "history"
_KEPT = "history before failures"
"""Kind of the entries that a failed run would have replaced; the next successful run of a node drops them."""
_NUMBERS = {int, float}


@dataclass(frozen=True, slots=True)
class Entry:
    """The last time a node was brought up to date."""

    key: str
    key_document: str
    """Digest of the key document."""
    run: str
    """Id of the run in which the node got this key."""
    seconds: float
    """Duration of the rule's run [s]."""
    time: float
    """Seconds since the epoch."""
    usage: Mapping[str, float] = field(default_factory=dict)
    """Resources used by its last run on this machine; see `Ended.usage`."""


class History:
    """Node address -> entry, for one recipe of one project.

    Args:
        store: Keeps the history in its machine-local part.
        recipe: Address of the recipe.
        workspace: The project; projects that share a store may have recipes of the same name.
        variant: Distinguishes the request from the recipe's default; "" for the default.
        last: Variant of the request built last.
    """

    def __init__(self, store: Store, recipe: str, workspace: str = "", variant: str = "", last: str = "") -> None:
        self._base = History(store, recipe, workspace, last if last != variant else "") if variant else None
        self._state = store.state
        self._kind, self._kept = ("\0".join((kind, workspace, recipe, variant)) for kind in (_KIND, _KEPT))
        self._entries: dict[str, Entry] | None = None
        self._noted: set[str] = set()
        """Addresses of entries that are not saved yet."""
        self._seen: dict[str, Entry | None] = {}
        """Address of each recorded node -> its entry before."""

    def get(self, address: str) -> Entry | None:
        """The entry of a node in this request, else in the one built last, else in the default; None without any."""
        return self._load().get(address) or (self._base.get(address) if self._base else None)

    def all(self) -> dict[str, Entry]:
        """Every entry of this request; where a failed run replaced one, the one before."""
        return self._load() | dict(_entries(self._state, self._kept))

    def note(self, address: str, entry: Entry) -> None:
        """Record a node; if its key is unchanged, the run that first had it stays."""
        known = self._load().get(address)
        self._seen.setdefault(address, known)
        if known is not None and known.key == entry.key and known.key_document == entry.key_document:
            if not entry.usage:
                return
            entry = replace(known, usage=entry.usage)
        elif known is not None and not entry.usage:
            entry = replace(entry, usage=known.usage)  # from its last run
        self._load()[address] = entry
        self._noted.add(address)

    def peak_gb(self, address: str) -> float | None:
        """Peak memory of a node's last run [GiB], if known."""
        known = self.get(address)
        peak = known.usage.get("memory_bytes") if known else None
        return peak / 2**30 if peak else None

    def save(self, *, ok: bool = True) -> None:
        """Save recorded entries next to those of other builds; a store that cannot be written stays as it is.

        Args:
            ok: Whether the run succeeded; the entries that a failed one replaces are kept for `all`.
        """
        known, kept = self._load(), self._state.all(self._kept) if self._seen else {}
        if not ok:
            before = {address: entry for address, entry in self._seen.items() if entry and address not in kept}
            lost = {address: _row(entry) for address, entry in before.items() if entry.key != known[address].key}
            if lost:
                self._state.put(self._kept, lost)
        if self._noted:
            self._state.put(self._kind, {address: _row(known[address]) for address in self._noted})
            self._noted.clear()
            failpoints.reach("history.saved")
        if ok and (gone := kept.keys() & self._seen.keys()):
            self._state.put(self._kept, {}, without=gone)

    def _load(self) -> dict[str, Entry]:
        if self._entries is None:
            self._entries = dict(_entries(self._state, self._kind))
        return self._entries


def projects(state: State) -> Iterator[tuple[str, str, Iterator[Entry]]]:
    """For every recipe: the workspace, the variant of the request, and its entries."""
    for kind in state.kinds():
        name, *rest = kind.split("\0")
        if name in (_KIND, _KEPT) and rest:
            yield rest[0], rest[-1], (entry for _, entry in _entries(state, kind))


def _entries(state: State, kind: str) -> Iterator[tuple[str, Entry]]:
    for address, data in state.all(kind).items():
        if (entry := _entry(data)) is not None:
            yield address, entry


def _entry(data: bytes) -> Entry | None:
    """The entry of a row; None if the row is invalid."""
    try:
        row = digests.plain(data)
        entry = Entry(*row)
        numbers = (entry.seconds, entry.time, *entry.usage.values())
    except (ValueError, TypeError, AttributeError):
        return None
    return entry if {*map(type, row[:3])} == {str} and {*map(type, numbers)} <= _NUMBERS else None


def _row(entry: Entry) -> bytes:
    return json.dumps([entry.key, entry.key_document, entry.run, entry.seconds, entry.time, dict(entry.usage)]).encode()
