"""Garbage collection of unused results and unneeded blobs, safe while builds run.

The latest results of workspaces stay, and so does everything that running builds may need; `store/last_use.py` explains
why. A kill at any moment is safe: results are removed before the blobs that they name, and results published meanwhile
are read before blobs are removed.
"""

from __future__ import annotations

import math
import os
import shutil
import time
from collections.abc import Callable, Mapping, Set
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from dextera_build.errors import StoreError
from dextera_build.gc import inventory
from dextera_build.gc import roots as held_by
from dextera_build.gc.choose import Horizon, Limits, choose
from dextera_build.runs import log
from dextera_build.store import failpoints, files, last_use
from dextera_build.store.store import Store

_RUN_S = 90 * 86400.0
"""Age from which the log of a run is removed if none of its results are held [s]."""
_LAST_RUNS = 20
"""Number of latest logs that stay regardless of age."""
_LOCKLESS_S = 86400.0
"""On a file system without locks, everything that was used within this time stays [s]."""
_WHY = {
    "broken": "they lack a blob or cannot be read",
    "age": "they were not used for longer than the age",
    "size": "the longest unused ones above the size",
}


Roots = Mapping[str, Set[str]]
"""Owner -> keys of the results that it holds."""


@dataclass(frozen=True)
class Row:
    """Items of one kind that are removed, or stay, for one reason."""

    kind: str
    count: int
    bytes: int
    why: str


@dataclass
class Collection:
    """Items that a collection removed, or would remove."""

    gone: list[Row] = field(default_factory=list)
    stays: list[Row] = field(default_factory=list)
    before: int = 0
    """Bytes of blobs, results and saved progress."""
    after: int = 0
    running: bool = False
    """Whether builds ran meanwhile."""
    vanished: list[str] = field(default_factory=list)
    """Projects whose folder is missing; their latest results are not held."""

    def add(self, kind: str, sizes: list[int], why: str) -> None:
        """Add a row of removed items."""
        if sizes:
            self.gone.append(Row(kind, len(sizes), sum(sizes), why))


def collect(store: Store, roots: Callable[[], Roots], limits: Limits | None = None, *, dry: bool = True) -> Collection:
    """Remove garbage and everything over the limits.

    Args:
        store: The store.
        roots: Called once no build can change the answer unnoticed; keys without a result are ignored.
        limits: Limits on the store's contents; None: only garbage is removed.
        dry: Change nothing, report what would be removed.

    Raises:
        StoreError: The store cannot be written, or a link lies in it.
    """
    inventory.refuse_links(store)
    limits = limits or Limits()
    if dry:
        return _Collector(store, roots(), limits, alone=store.locks.reliable() and not store.running.starts()).said
    if (folder := inventory.unwritable(store)) is not None:
        raise StoreError(
            "the store is read-only, nothing can be collected",
            code="DXB-S401",
            facts={"folder": str(folder)},
            hint="ask its owner, or set `DXB_CACHE` to a store of your own",
        )
    with store.running.collecting() as alone:
        return _Collector(store, roots(), limits, alone=alone).sweep()


def collect_all(store: Store, *, size: int | None = None, age_s: float | None = None, dry: bool = True) -> Collection:
    """Remove results over the limits that no project holds and no build used recently, unneeded blobs, and old logs.

    Args:
        store: The store.
        size: Size limit of the store [bytes].
        age_s: Age limit of unused results [s].
        dry: Change nothing, report what would be removed.

    Raises:
        StoreError: The store cannot be written, or a link lies in it.
    """
    if not store.root.is_dir():
        return Collection()
    since = time.time() - age_s if age_s is not None else None
    held = held_by.Roots()

    def look() -> Roots:
        nonlocal held
        held = held_by.find(store)
        return held.keys

    said = collect(store, look, Limits(size, since), dry=dry)
    said.vanished = held.vanished
    logs = _old_logs(store, held.runs, _RUN_S if age_s is None else age_s)
    said.add("runs", [_bytes(path) for path in logs], "logs of old runs that made nothing that is held")
    if not dry:
        for path in logs:
            with suppress(OSError):
                failpoints.reach("collect.log")
                shutil.rmtree(path)
    return said


class _Collector:
    """Chooses what to remove when it is created; `said` reports it, and `sweep` removes it."""

    def __init__(self, store: Store, roots: Roots, limits: Limits, *, alone: bool) -> None:
        self._store = store
        starts = store.running.starts()
        grace = last_use.STEP_S + last_use.SLACK_S
        if not store.locks.reliable():
            grace = max(grace, _LOCKLESS_S)
        horizon = min([_now(store), *starts]) - grace
        self._horizon = Horizon(results=math.inf if alone else horizon, blobs=horizon)
        self._held = inventory.read(store)
        everyone = frozenset().union(*roots.values())
        # A result names the key documents of its recorded calls, whose digests are the keys of the calls.
        results = self._held.results
        everyone |= {name for key in everyone if key in results for name in results[key].needs if name in results}
        self._choice = choose(self._held, everyone, limits, self._horizon)
        self._leftovers = [left for left in inventory.leftovers(store) if left[2] < horizon]
        self._entries = results | self._held.broken
        self.said = Collection(before=self._held.bytes(), after=self._choice.left, running=bool(starts))
        self._say_gone()
        self._say_kept(roots)

    def _say_gone(self) -> None:
        held, choice, said = self._held, self._choice, self.said
        for reason, why in _WHY.items():
            gone = [self._entries[key].size for key, because in choice.results.items() if because == reason]
            said.add("results", gone, why)
        said.add("blobs", [held.blobs[digest][0] for digest in choice.blobs], "no result that stays needs them")
        said.add("keep", [held.keep[key][0] for key in choice.keep], "progress of abandoned calls")
        left = [size for _, size, _ in self._leftovers]
        said.add("leftovers", left, "unfinished files of killed processes, damaged blobs in quarantine")

    def _say_kept(self, roots: Roots) -> None:
        blobs = self._held.blobs
        left = {key: entry for key, entry in self._held.results.items() if key not in self._choice.results}
        counted = set(self._choice.blobs)
        young = {key for key, entry in left.items() if entry.used >= self._horizon.results}
        groups = [(keys, f"built last by {owner}") for owner, keys in sorted(roots.items())]
        for keys, why in (*groups, (young, "builds that run now may need them"), (set(left), "within the limits")):
            kept = [left.pop(key) for key in keys & left.keys()]
            names = {name for entry in kept for name in entry.needs if name in blobs} - counted
            counted |= names
            if kept:
                size = sum(entry.size for entry in kept) + sum(blobs[name][0] for name in names)
                self.said.stays.append(Row("results", len(kept), size, why))
        fresh = [size for digest, (size, _) in blobs.items() if digest not in counted]
        if fresh:
            self.said.stays.append(
                Row("blobs", len(fresh), sum(fresh), "no result needs them, but they were used of late")
            )

    def sweep(self) -> Collection:
        """Remove what was chosen, except for items that a build has used since."""
        use, choice = self._store.blobs.use, self._choice
        spared = 0
        for key in choice.results:
            path = inventory.path_of(self._store, key)
            spared += not use.drop(path, math.nextafter(self._entries[key].used, math.inf))
        failpoints.reach("collect.results")
        needed = self._needed()
        for digest in sorted(choice.blobs - needed):
            path, used = str(self._store.blobs.path(digest)), self._held.blobs[digest][1]
            spared += not use.drop(path, math.nextafter(used, math.inf))
        for key in choice.keep:
            if self._store.locks.take(key):
                self._store.keep.drop(key)
                self._store.locks.release(key)
        failpoints.reach("collect.blobs")
        for left, _, _ in self._leftovers:
            with suppress(OSError):
                files.remove(left)
        if spared or needed & choice.blobs:
            self.said.after = inventory.read(self._store).bytes()
        return self.said

    def _needed(self) -> set[str]:
        """Blobs that the remaining results need, including results published since the inventory."""
        known = frozenset(key for key in self._held.results if key not in self._choice.results)
        needed = {name for key in known for name in self._held.results[key].needs}
        for _, kept in inventory.results(self._store, known):
            needed.update(kept.needs)
        return needed


def _now(store: Store) -> float:
    """The current time of the clock that stamps the store's files."""
    path = store.local / f"{files.TEMPORARY}-{files.unique()}"
    try:
        path.write_bytes(b"")
        stamp = path.stat().st_mtime
        path.unlink()
    except OSError:
        return time.time()
    return stamp


def _old_logs(store: Store, held: set[str], age_s: float) -> list[Path]:
    folder = store.root / "runs"
    found = []
    for run in log.runs(store)[:-_LAST_RUNS]:
        with suppress(OSError):
            if run not in held and _changed(folder / run) < time.time() - age_s:
                found.append(folder / run)
    return found


def _changed(folder: Path) -> float:
    return max(os.stat(path).st_mtime for path in (folder, *folder.iterdir()))


def _bytes(path: Path) -> int:
    return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
