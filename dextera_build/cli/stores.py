"""The store as verbs see it that only read: a folder that is not there stays so, and that is said."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from dextera_build.store.store import Store

if TYPE_CHECKING:
    from dextera_build.project import Project

_absent: dict[str, str] = {}
"""A store's folder that was looked for and is not there, as it is shown -> where its name comes from."""


def reading(project: Project) -> Store:
    """The store of a project, for a verb that only reads; none is made."""
    store = Store(project.cache, make=False)
    if not store.root.is_dir():
        _absent[project.shown(store.root)] = project.config["cache"].origin
    return store


def warn() -> None:
    """Say on standard error which stores are not there; each once."""
    for folder, origin in _absent.items():
        print(f"warning: there is no store at `{folder}` yet (from: {origin})", file=sys.stderr)
    _absent.clear()
