"""A collection of a whole store: blobs and results, and what the engine remembers of runs that are long over."""

from __future__ import annotations

import os
import shutil
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from dextera_build.gc import roots
from dextera_build.gc.choose import Limits
from dextera_build.gc.collect import Collection
from dextera_build.gc.collect import collect as collect_store
from dextera_build.runs import log
from dextera_build.store import failpoints
from dextera_build.store.store import Store

_RUN_S = 90 * 86400.0
"""Age from which the log of a run that made nothing that is still held goes [s]."""
_LAST_RUNS = 20
"""So many logs stay whatever their age."""


@dataclass(frozen=True)
class Answer:
    """What a collection took or would take, and which workspaces no longer count."""

    said: Collection
    vanished: tuple[str, ...]


def collect(store: Store, *, size: int | None = None, age_s: float | None = None, dry: bool = True) -> Answer:
    """Take what may go: results that no workspace built last and nobody used of late, blobs that none needs, old logs.

    Args:
        store: The store.
        size: Bytes that it shall hold at most.
        age_s: Results that were not used for so long [s] go.
        dry: Change nothing, say what would go.

    Raises:
        StoreError: The store cannot be written.
    """
    if not store.root.is_dir():
        return Answer(Collection(), ())
    since = time.time() - age_s if age_s is not None else None
    held = roots.Roots()

    def look() -> dict[str, set[str]]:
        nonlocal held
        held = roots.find(store)
        return held.keys

    said = collect_store(store, look, Limits(size, since), dry=dry)
    logs = _old_logs(store, held.runs, _RUN_S if age_s is None else age_s)
    said.add("runs", [_bytes(path) for path in logs], "logs of old runs that made nothing that is held")
    if not dry:
        for path in logs:
            with suppress(OSError):
                failpoints.reach("collect.log")
                shutil.rmtree(path)
    return Answer(said, tuple(held.vanished))


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
    files = [path] if path.is_file() else [file for file in path.rglob("*") if file.is_file()]
    return sum(file.stat().st_size for file in files)
