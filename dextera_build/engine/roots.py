"""Whose results a collection leaves alone: those that a workspace's recipes built last, by all that remembers them."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from dextera_build.store import files
from dextera_build.store.store import Store

LOCKFILE = "dxb.lock"
NOBODY = "builds outside a project"

_KEY = re.compile(rb"(?<![0-9a-f])[0-9a-f]{64}(?![0-9a-f])")
_ENTRY = re.compile(rb"/ac/([0-9a-f]{2})/([0-9a-f]{62})(?![0-9a-f])")
_ROW, _ANY_SIZE = 40, b"\xff" * 8
_SNAPSHOT_S = 30 * 86400.0
"""A snapshot that was not written for so long [s] holds on to nothing; history still does."""


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
    for workspace, keys, runs in _histories(store.local / "history"):
        if workspace not in found.vanished:
            found.keys.setdefault(workspace or NOBODY, set()).update(keys)
            found.runs |= runs
    for paths, workspace, keys, written in _snapshots(store.local / "snapshots"):
        if workspace in found.vanished or written < time.time() - _SNAPSHOT_S:
            found.snapshots += paths
        elif keys:
            found.keys.setdefault(workspace or NOBODY, set()).update(keys)
    for workspace, held in found.keys.items():
        with suppress(OSError):
            # Whatever form the file has: its digests are written out.
            held.update(match.decode() for match in _KEY.findall(files.read(f"{workspace}/{LOCKFILE}")))
    return found


def _histories(folder: Path) -> Iterator[tuple[str, set[str], set[str]]]:
    for path in _files(folder):
        with suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
            stored = json.loads(files.read(str(path)))
            rows = [row for row in stored["nodes"].values() if isinstance(row, list)]
            yield str(stored.get("project", "")), {str(row[0]) for row in rows}, {str(row[2]) for row in rows}


def _snapshots(folder: Path) -> Iterator[tuple[list[Path], str, set[str], float]]:
    parts: dict[str, list[Path]] = {}
    for path in _files(folder):
        parts.setdefault(path.name.partition(".")[0], []).append(path)
    for paths in parts.values():
        keys: set[str] = set()
        workspace, written = "", 0.0
        for path in paths:
            with suppress(OSError):
                data, stamp = files.read_stamped(str(path))
                keys |= {(shard + rest).decode() for shard, rest in _ENTRY.findall(data)} | _packed(data)
                workspace, written = workspace or _workspace(data), max(written, stamp)
        yield paths, workspace, keys, written


def _packed(data: bytes) -> set[str]:
    """Keys in rows of 32 bytes of digest and 8 bytes that stand for any size, as results have them."""
    if len(data) % _ROW:
        return set()
    rows = (data[place : place + _ROW] for place in range(0, len(data), _ROW))
    return {row[:32].hex() for row in rows if row[32:] == _ANY_SIZE}


def _workspace(snapshot: bytes) -> str:
    for text in (snapshot, snapshot.partition(b"\n")[2]):
        with suppress(ValueError, KeyError, TypeError):
            return str(json.loads(text)["request"]["root"])
    return ""


def _files(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if not path.name.startswith(files.TEMPORARY))
