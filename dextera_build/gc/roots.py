"""The results that a collection always keeps: the latest of each workspace's recipes, from history and lock files."""

from __future__ import annotations

import os
import re
import time
from contextlib import suppress
from dataclasses import dataclass, field

from dextera_build.runs import history, workspaces
from dextera_build.store import files
from dextera_build.store.store import Store

LOCKFILE = "dxb.lock"
NOBODY = "builds outside a project"

_KEY = re.compile(rb"(?<![0-9a-f])[0-9a-f]{64}(?![0-9a-f])")
_VARIANT_S = 30 * 86400.0
"""Age from which requests with other flags than the recipe's own, and other machines, hold no results [s]."""


@dataclass
class Roots:
    """The holders of results."""

    keys: dict[str, set[str]] = field(default_factory=dict)
    """Workspace -> keys."""
    vanished: list[str] = field(default_factory=list)
    """Workspaces whose folder is missing; they hold no results."""
    runs: set[str] = field(default_factory=set)
    """Runs that made the held results."""


def find(store: Store) -> Roots:
    """Read the history and the lock files of workspaces."""
    found = Roots()
    vanished: set[str] = set()
    locks: dict[str, str] = {}
    for workspace, variant, entries in history.projects(store.state):
        folder, is_here = workspaces.folder(workspace), workspaces.is_here(workspace)
        if workspace and is_here and not os.path.isdir(folder):
            vanished.add(folder)
        else:
            owner = (folder if is_here else f"{folder} on another machine") or NOBODY
            keys = found.keys.setdefault(owner, set())
            if workspace and is_here:
                locks[owner] = f"{folder}/{LOCKFILE}"
            for entry in entries:
                # Whether the project still exists cannot be seen from another machine.
                if (variant or not is_here) and entry.time < time.time() - _VARIANT_S:
                    continue
                keys.add(entry.key)
                found.runs.add(entry.run)
    found.vanished = sorted(vanished)
    for owner, path in locks.items():
        with suppress(OSError):
            # This works for any format of the file: digests are written out.
            found.keys[owner].update(match.decode() for match in _KEY.findall(files.read(path)))
    return found
