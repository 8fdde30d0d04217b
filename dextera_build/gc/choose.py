"""What of a store may go: a pure function of what it holds, what must stay, and the limits."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Set
from dataclasses import dataclass, field
from typing import Literal

from dextera_build.gc.inventory import Inventory

Reason = Literal["broken", "age", "size"]


@dataclass(frozen=True)
class Limits:
    """What a store shall hold at most."""

    size: int | None = None
    """Bytes, None for any number."""
    since: float | None = None
    """Results that were used before (seconds since the epoch) go."""


@dataclass(frozen=True)
class Horizon:
    """Running builds may need whatever was used at these times or later (seconds since the epoch)."""

    results: float
    """For results, and for the blobs that any result names."""
    blobs: float
    """For blobs that no result names: they may be there for one that is about to be published."""


@dataclass
class Choice:
    """What goes."""

    results: dict[str, Reason] = field(default_factory=dict)
    """Key -> why."""
    blobs: set[str] = field(default_factory=set)
    keep: dict[str, Reason] = field(default_factory=dict)
    left: int = 0
    """Bytes that stay."""


def choose(inventory: Inventory, roots: Set[str], limits: Limits, horizon: Horizon) -> Choice:
    """Choose what goes: broken results, blobs that nothing needs, results by age, then the oldest down to the size.

    Results under `roots` stay whatever the limits say, and so does all that running builds may need.
    """
    made = _Chooser(inventory, horizon)
    for key in inventory.broken:
        made.drop_result(key, "broken")
    for digest in inventory.blobs:
        made.drop_blob(digest)
    for used, kind, key in _candidates(inventory, roots, horizon):
        reason: Reason
        if limits.since is not None and used < limits.since:
            reason = "age"
        elif limits.size is not None and made.choice.left > limits.size:
            reason = "size"
        else:
            break
        if kind == "keep":
            made.drop_keep(key, reason)
        else:
            made.drop_result(key, reason)
    return made.choice


def _candidates(inventory: Inventory, roots: Set[str], horizon: Horizon) -> list[tuple[float, str, str]]:
    """(last use, what, key) of all that limits apply to, the longest unused first."""
    found = [(entry.used, "result", key) for key, entry in inventory.results.items() if key not in roots]
    found += [(used, "keep", key) for key, (_, used) in inventory.keep.items()]
    return sorted(row for row in found if row[0] < horizon.results)


class _Chooser:
    def __init__(self, inventory: Inventory, horizon: Horizon) -> None:
        self._inventory = inventory
        self._horizon = horizon
        self._named = {name for entry in inventory.broken.values() for name in entry.needs}
        self._readers = Counter(name for entry in inventory.results.values() for name in entry.needs)
        self.choice = Choice(left=inventory.bytes())

    def drop_result(self, key: str, reason: Reason) -> None:
        """Let a result go, and each blob that only it needs."""
        self.choice.results[key] = reason
        if reason == "broken":
            self.choice.left -= self._inventory.broken[key].size
            return
        entry = self._inventory.results[key]
        self.choice.left -= entry.size
        for name in entry.needs:
            self._readers[name] -= 1
            self._named.add(name)
            self.drop_blob(name)

    def drop_blob(self, digest: str) -> None:
        """Let a blob go, unless a result needs it or a running build may."""
        horizon = self._horizon.results if digest in self._named else self._horizon.blobs
        size, used = self._inventory.blobs.get(digest, (0, math.inf))  # a bare result names blobs that are not there
        if not self._readers[digest] and used < horizon:
            self.choice.blobs.add(digest)
            self.choice.left -= size

    def drop_keep(self, key: str, reason: Reason) -> None:
        """Let the saved progress of a call go."""
        self.choice.keep[key] = reason
        self.choice.left -= self._inventory.keep[key][0]
