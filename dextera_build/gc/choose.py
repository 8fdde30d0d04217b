"""Chooses the files that a collection removes: a pure function of the inventory, the roots and the limits."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Set
from dataclasses import dataclass, field
from typing import Literal

from dextera_build.gc.inventory import Inventory, Kept

Reason = Literal["broken", "age", "size"]


@dataclass(frozen=True)
class Limits:
    """Limits on the contents of a store."""

    size: int | None = None
    """Most bytes; None: no limit."""
    since: float | None = None
    """Results last used before this time (seconds since the epoch) are removed; None: no limit."""


@dataclass(frozen=True)
class Horizon:
    """Running builds may need anything that was used at these times or later (seconds since the epoch)."""

    results: float
    """For results, and for the blobs that any result names."""
    blobs: float
    """For blobs that no result names: a result that needs them may be about to be published."""


@dataclass
class Choice:
    """The items that a collection removes."""

    results: dict[str, Reason] = field(default_factory=dict)
    """Key -> reason."""
    blobs: set[str] = field(default_factory=set)
    keep: dict[str, Reason] = field(default_factory=dict)
    left: int = 0
    """Bytes that stay."""


def choose(inventory: Inventory, roots: Set[str], limits: Limits, horizon: Horizon) -> Choice:
    """Choose broken results, unneeded blobs, results over the age limit, then the least recently used down to the size.

    Results under `roots` stay regardless of the limits, and so does everything that running builds may need.
    """
    choice = Choice(left=inventory.bytes())
    named = {name for entry in inventory.broken.values() for name in entry.needs}
    readers = Counter(name for entry in inventory.results.values() for name in entry.needs)

    def drop_blobs(digests: Iterable[str]) -> None:
        for digest in digests:
            size, used = inventory.blobs.get(digest, (0, math.inf))  # a bare result names missing blobs
            if not readers[digest] and used < (horizon.results if digest in named else horizon.blobs):
                choice.blobs.add(digest)
                choice.left -= size

    for key, entry in inventory.broken.items():
        choice.results[key] = "broken"
        choice.left -= entry.size
    drop_blobs(inventory.blobs)
    for used, key, kept in _candidates(inventory, roots):
        is_old = limits.since is not None and used < limits.since
        is_too_much = limits.size is not None and choice.left > limits.size
        if used >= horizon.results or not (is_old or is_too_much):
            break
        reason: Reason = "age" if is_old else "size"
        if kept is None:
            choice.keep[key] = reason
            choice.left -= inventory.keep[key][0]
        else:
            choice.results[key] = reason
            choice.left -= kept.size
            readers.subtract(kept.needs.keys())
            named.update(kept.needs)
            drop_blobs(kept.needs)
    return choice


def _candidates(inventory: Inventory, roots: Set[str]) -> list[tuple[float, str, Kept | None]]:
    """(last use, key, result or None for saved progress) of everything under the limits, least recently used first."""
    found: list[tuple[float, str, Kept | None]] = [
        (kept.used, key, kept) for key, kept in inventory.results.items() if key not in roots
    ]
    found += [(used, key, None) for key, (_, used) in inventory.keep.items()]
    return sorted(found, key=lambda row: row[:2])
