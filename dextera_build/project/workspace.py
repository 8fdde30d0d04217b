"""Workspaces: the projects that build with a store, kept apart even if they share it and have recipes of equal names.

A store belongs to a project if it is in its folder. Everywhere else, other projects, users and machines may use it,
too; there a workspace is a project folder on one machine, and its files in `out/` are below a folder of its own.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from dextera_build import digest as digests
from dextera_build.project.project import Project, find
from dextera_build.runs import workspaces

_LONGEST = 40
"""Maximum length [characters] of the readable part of a folder's name."""


def owns_store(project: Project) -> bool:
    """Whether the project's store is in its folder, and in no other project's folder inside it."""
    root, store = (Path(os.path.realpath(path)) for path in (project.root, project.cache))
    if not project.declared or not store.is_relative_to(root):
        return False
    holder = find(store)
    return not holder.declared or holder.root == root or not holder.root.is_relative_to(root)


def workspace(project: Project) -> str:
    """The name of a project in the records of its store."""
    return workspaces.name(str(project.root), shared=not owns_store(project))


def folder_name(project: Project) -> str:
    """The folder of a workspace in the `out/` of a store that others may use, too: `lab-1a2b3c4d5e6f`."""
    readable = re.sub(r"[^A-Za-z0-9._]+", "-", project.root.name)[:_LONGEST].strip("-.")
    return f"{readable or 'project'}-{digests.of_value(workspace(project))[:12]}"
