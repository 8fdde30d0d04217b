"""Garbage collection: results that nobody uses and blobs that no result needs go, while builds run.

What workspaces built last stays, and what running builds may need; `use.py` says why that holds. The order makes every
moment of it safe, a kill included: results go before the blobs that they name, and what is published meanwhile is read
before blobs go.
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
from dextera_build.gc.choose import Choice, Horizon, Limits, choose
from dextera_build.gc.inventory import Inventory
from dextera_build.runs import log
from dextera_build.store import failpoints, files, last_use
from dextera_build.store.store import Store

_RUN_S = 90 * 86400.0
"""Age from which the log of a run that made nothing that is still held goes [s]."""
_LAST_RUNS = 20
"""So many logs stay whatever their age."""
_LOCKLESS_S = 86400.0
"""Where a file system has no locks, all that was used in this time stays [s]."""
_WHY = {
    "broken": "they lack a blob or cannot be read",
    "age": "they were not used for longer than the age",
    "size": "the longest unused ones above the size",
}


Roots = Mapping[str, Set[str]]
"""Whoever holds on to results -> keys of these."""


@dataclass(frozen=True)
class Row:
    """Some things of one kind that go, or stay, for one reason."""

    kind: str
    count: int
    bytes: int
    why: str


@dataclass
class Collection:
    """What a collection took, or would take."""

    gone: list[Row] = field(default_factory=list)
    stays: list[Row] = field(default_factory=list)
    before: int = 0
    """Bytes of blobs, results and saved progress."""
    after: int = 0
    running: int = 0
    """How many builds ran meanwhile."""
    vanished: list[str] = field(default_factory=list)
    """Projects whose folder is not there: what they built last is not held."""

    def add(self, kind: str, sizes: list[int], why: str) -> None:
        """Note what goes."""
        if sizes:
            self.gone.append(Row(kind, len(sizes), sum(sizes), why))


def collect(store: Store, roots: Callable[[], Roots], limits: Limits | None = None, *, dry: bool = True) -> Collection:
    """Take what may go.

    Args:
        store: The store.
        roots: Asked once no build can change the answer unseen; keys without a result are passed over.
        limits: What the store shall hold at most; None: any amount, and only garbage goes.
        dry: Change nothing, say what would go.

    Raises:
        StoreError: The store cannot be written.
    """
    if dry:
        return _Collector(
            store, roots(), limits or Limits(), alone=store.locks.reliable() and not store.running.starts()
        ).plan()
    if (folder := inventory.unwritable(store)) is not None:
        raise StoreError(
            "the store cannot be collected, it may only be read",
            code="DXB-S401",
            facts={"folder": str(folder)},
            hint="ask its owner, or set `DXB_CACHE` to a store of your own",
        )
    with store.running.collecting() as alone:
        return _Collector(store, roots(), limits or Limits(), alone=alone).sweep()


def collect_all(store: Store, *, size: int | None = None, age_s: float | None = None, dry: bool = True) -> Collection:
    """Take what may go: results that no project built last and nobody used of late, blobs that none needs, old logs.

    Args:
        store: The store.
        size: Bytes that it shall hold at most.
        age_s: Results that were not used for so long [s] go.
        dry: Change nothing, say what would go.

    Raises:
        StoreError: The store cannot be written.
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
    def __init__(self, store: Store, roots: Roots, limits: Limits, *, alone: bool) -> None:
        self._store = store
        self._roots = roots
        starts = store.running.starts()
        now = _now(store)
        grace = last_use.STEP_S + last_use.SLACK_S
        if not store.locks.reliable():
            grace = max(grace, _LOCKLESS_S)
        horizon = min([now, *starts]) - grace
        self._horizon = Horizon(results=math.inf if alone else horizon, blobs=horizon)
        self._held = inventory.read(store)
        everyone = frozenset().union(*roots.values())
        # A result names the key documents of the calls that it came of, and their digests are the keys of these.
        results = self._held.results
        everyone |= {name for key in everyone if key in results for name in results[key].needs if name in results}
        self._choice = choose(self._held, everyone, limits, self._horizon)
        self._said = Collection(before=self._held.bytes(), after=self._choice.left, running=store.running.processes())

    def plan(self) -> Collection:
        """Say what would go."""
        held, choice, said = self._held, self._choice, self._said
        entries = held.results | held.broken
        for reason, why in _WHY.items():
            said.add("results", [entries[key].size for key, said in choice.results.items() if said == reason], why)
        said.add("blobs", [held.blobs[digest][0] for digest in choice.blobs], "no result that stays needs them")
        said.add("keep", [held.keep[key][0] for key in choice.keep], "progress of abandoned calls")
        left = [size for _, size, used in inventory.leftovers(self._store) if used < self._horizon.blobs]
        said.add("leftovers", left, "unfinished files of killed processes, damaged blobs in quarantine")
        said.stays = list(_stays(held, choice, self._roots, self._horizon))
        return said

    def sweep(self) -> Collection:
        """Take it."""
        said = self.plan()
        spared = self._drop_results()
        failpoints.reach("collect.results")
        needed = self._needed(spared)
        for digest in sorted(self._choice.blobs - needed):
            path = str(self._store.blobs.path(digest))
            used = self._held.blobs[digest][1]
            if not self._store.blobs.use.drop(path, math.nextafter(used, math.inf)):
                spared.add(digest)
        for key in self._choice.keep:
            if self._store.locks.take(key):
                self._store.keep.drop(key)
                self._store.locks.release(key)
        failpoints.reach("collect.blobs")
        for path, _, used in inventory.leftovers(self._store):
            if used < self._horizon.blobs:
                with suppress(OSError):
                    inventory.remove(path)
        if spared or needed & self._choice.blobs:
            said.after = inventory.read(self._store).bytes()
        return said

    def _drop_results(self) -> set[str]:
        """Remove results; returns those that a build began to use since we looked."""
        spared = set()
        entries = self._held.results | self._held.broken
        for key in self._choice.results:
            path = inventory.path_of(self._store, key)
            if not self._store.blobs.use.drop(path, math.nextafter(entries[key].used, math.inf)):
                spared.add(key)
        return spared

    def _needed(self, spared: Set[str]) -> set[str]:
        """Blobs that results need which are still there, also those published since we looked."""
        known = frozenset(key for key in self._held.results if key not in self._choice.results)
        needed = {name for key in known for name in self._held.results[key].needs}
        for _, (entry, _) in inventory.results(self._store, known):
            needed.update(entry.needs)
        return needed


def _stays(held: Inventory, choice: Choice, roots: Roots, horizon: Horizon) -> list[Row]:
    left = {key: entry for key, entry in held.results.items() if key not in choice.results}
    rows = []

    def take(keys: list[str], why: str) -> None:
        names = {name for key in keys for name in left[key].needs if name in held.blobs} - counted
        counted.update(names)
        size = sum(left.pop(key).size for key in keys) + sum(held.blobs[name][0] for name in names)
        if keys:
            rows.append(Row("results", len(keys), size, why))

    counted: set[str] = set()
    for owner, keys in sorted(roots.items()):
        take([key for key in left if key in keys], f"built last by {owner}")
    take([key for key, entry in left.items() if entry.used >= horizon.results], "builds that run now may need them")
    take(list(left), "within the limits")
    accounted = choice.blobs | counted
    young = [size for digest, (size, _) in held.blobs.items() if digest not in accounted]
    if young:
        rows.append(Row("blobs", len(young), sum(young), "no result needs them, but they were used of late"))
    return rows


def _now(store: Store) -> float:
    """The time by the clock that stamps the store's files."""
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
