"""What a build read and what it placed: its answer holds as long as both are as they were."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

from dextera_build.store.signature import Signature

if TYPE_CHECKING:
    from dextera_build.project.project import Project
    from dextera_build.recipe.plan import Plan
    from dextera_build.store.signature import Watch


Signatures: TypeAlias = dict[str, Signature]
"""Path -> signature of the file."""


@dataclass
class Placed:
    """What a build placed or found in place."""

    paths: dict[str, str] = field(default_factory=dict)
    """Address of a target -> whole path of its main file."""
    present: Signatures = field(default_factory=dict)
    """Whole path -> signature of every file of the targets, as it was written."""
    kept: dict[str, str] = field(default_factory=dict)
    """Address of a target whose files somebody changed -> folder in which these are now."""
    removed: list[str] = field(default_factory=list)
    """Addresses of nodes whose copies were out of date."""


def note(project: Project, watch: Watch, plan: Plan) -> None:
    """Note what planning read: recipes, code, configuration, and folders in which a new one would lie."""
    from dextera_build.code.modules import was_read

    recipes = {str(path) for path in plan.recipes}
    for path in (*recipes, *project.looked_at()):
        if os.path.isdir(path):
            watch.folder(path)
        else:
            watch.file(path)
        watch.doubt(path, was_read=path in recipes or was_read(path))


def note_packages(watch: Watch) -> None:
    """Note what can be imported, and which packages are installed; before anything is looked for."""
    for entry in sys.path:
        watch.modules(entry or os.getcwd())
