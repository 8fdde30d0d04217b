"""Whose results a collection leaves alone: those that a workspace's recipes built last, by all that remembers them."""

from __future__ import annotations

import os
import re
import time
from contextlib import suppress
from dataclasses import dataclass, field

from dextera_build.runs import history
from dextera_build.store import files
from dextera_build.store.store import Store

LOCKFILE = "dxb.lock"
NOBODY = "builds outside a project"

_KEY = re.compile(rb"(?<![0-9a-f])[0-9a-f]{64}(?![0-9a-f])")
_VARIANT_S = 30 * 86400.0
"""Requests with other flags than the recipe's own hold on to nothing after so long [s]."""


@dataclass
class Roots:
    """Who holds on to what."""

    keys: dict[str, set[str]] = field(default_factory=dict)
    """Workspace -> keys."""
    vanished: list[str] = field(default_factory=list)
    """Workspaces whose folder is not there: they hold on to nothing."""
    runs: set[str] = field(default_factory=set)
    """Runs that made what is held."""


def find(store: Store) -> Roots:
    """Read what remembers results: history and lock files of workspaces."""
    found = Roots()
    vanished: set[str] = set()
    for workspace, variant, entries in history.projects(store.state):
        if workspace and not os.path.isdir(workspace):
            vanished.add(workspace)
        else:
            keys = found.keys.setdefault(workspace or NOBODY, set())
            for entry in entries:
                if variant and entry.time < time.time() - _VARIANT_S:
                    continue
                keys.add(entry.key)
                found.runs.add(entry.run)
    found.vanished = sorted(vanished)
    for workspace, held in found.keys.items():
        with suppress(OSError):
            # Whatever form the file has: its digests are written out.
            held.update(match.decode() for match in _KEY.findall(files.read(f"{workspace}/{LOCKFILE}")))
    return found
