"""Whose results a collection leaves alone: those that a workspace's recipes built last, by all that remembers them."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from dextera_build.engine import history, snapshot
from dextera_build.store import files
from dextera_build.store.store import Store

LOCKFILE = "dxb.lock"
NOBODY = "builds outside a project"

_KEY = re.compile(rb"(?<![0-9a-f])[0-9a-f]{64}(?![0-9a-f])")
_SNAPSHOT_S = 30 * 86400.0
"""A snapshot that was not used for so long [s] holds on to nothing, and neither does the past of a request with other
flags than the recipe's own; the past of that still does."""


@dataclass
class Roots:
    """Who holds on to what."""

    keys: dict[str, set[str]] = field(default_factory=dict)
    """Workspace -> keys."""
    vanished: list[str] = field(default_factory=list)
    """Workspaces whose folder is not there: they hold on to nothing."""
    runs: set[str] = field(default_factory=set)
    """Runs that made what is held."""
    snapshots: list[Path] = field(default_factory=list)
    """Snapshots that hold on to nothing: old ones, and those of workspaces that vanished."""


def find(store: Store) -> Roots:
    """Read what remembers results: history, snapshots of builds that did nothing, and lock files of workspaces."""
    workspaces = store.workspaces.all()
    found = Roots(
        keys={workspace: set() for workspace, is_there in workspaces.items() if is_there},
        vanished=[workspace for workspace, is_there in workspaces.items() if not is_there],
    )
    for workspace, variant, entries in history.projects(store.state):
        if workspace not in found.vanished:
            for entry in entries:
                if variant and entry.time < time.time() - _SNAPSHOT_S:
                    continue
                found.keys.setdefault(workspace or NOBODY, set()).add(entry.key)
                found.runs.add(entry.run)
    for paths, workspace, keys, written in _snapshots(store.local / "snapshots"):
        if workspace in found.vanished or written < time.time() - _SNAPSHOT_S:
            found.snapshots += paths
        elif keys:
            found.keys.setdefault(workspace or NOBODY, set()).update(keys)
    for workspace, held in found.keys.items():
        # A damaged history may name a folder that no system could have: `ValueError`.
        with suppress(OSError, ValueError):
            # Whatever form the file has: its digests are written out.
            held.update(match.decode() for match in _KEY.findall(files.read(f"{workspace}/{LOCKFILE}")))
    return found


def _snapshots(folder: Path) -> Iterator[tuple[list[Path], str, set[str], float]]:
    parts: dict[str, list[Path]] = {}
    for path in _files(folder):
        parts.setdefault(path.name.partition(".")[0], []).append(path)
    for name, paths in parts.items():
        keys: set[str] = set()
        workspace, used = "", 0.0
        # One that was damaged, or that another version wrote, serves no build any more: history holds what it held.
        with suppress(OSError, ValueError, KeyError, TypeError, AttributeError, IndexError):
            used = (folder / name).stat().st_mtime
            workspace, keys = snapshot.held(folder / name)
        yield paths, workspace, keys, used


def _files(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if not path.name.startswith(files.TEMPORARY))
