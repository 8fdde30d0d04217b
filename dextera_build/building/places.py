"""Places of files in `out/`: no two of workspaces, recipes, requests and nodes share a folder."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from dextera_build import digest as digests
from dextera_build.engine.graph import parse_address
from dextera_build.project.project import Project
from dextera_build.project.workspace import folder_name, owns_store
from dextera_build.store.locks import Locks

OUT = "out"
_CODES = str.maketrans({"/": "%2F", ":": "%3A", "%": "%25"})
_IN_LABELS = {**_CODES, **str.maketrans({".": "%2E"})}
_LONGEST = 230
"""Maximum length of a folder's name [bytes]; unfinished and kept folders have longer names."""


@dataclass(frozen=True)
class Place:
    """The folder of one recipe and request, and the locks of the `out/` that it lies in."""

    folder: str
    """Absolute path."""
    locks: Locks
    lock: str
    """Key of the folder's lock."""


def of(project: Project, recipe: str, variant: str = "") -> Place:
    """The place of a recipe's files.

    They lie in the store: in a project's own store at `out/<recipe>`, in every other one below a folder of the
    workspace. If that one can only be read, they lie in the project's `cache/out`.
    """
    holder, inside = project.cache, Path(OUT)
    if not owns_store(project):
        if os.access(holder / OUT if (holder / OUT).is_dir() else holder, os.W_OK):
            inside /= folder_name(project)
        else:
            holder = project.root.absolute() / "cache"
    inside /= f"{_recipe(project, recipe)}{variant}"
    lock = digests.of_bytes(f"out {inside}".encode())
    return Place(os.path.abspath(holder / inside), Locks(holder / "local" / "locks"), lock)


def name_of(node: str) -> str:
    """The folder of a node below that of its recipe: `body.mug.mesh` for `body[mug].mesh`, which no shell misreads.

    Dots of labels have another spelling, so no two nodes of a recipe share a folder. Names that are too long for a
    folder end in their digest.
    """
    path, labels, said = parse_address(node), list[str](), list[str]()
    labels += path.labels or ()
    for depth, part in enumerate(path.call):
        said.append(part.translate(_CODES))
        said += [labels[depth].translate(_IN_LABELS)] if depth < len(labels) else []
    name = ".".join(said)
    if len(name.encode()) <= _LONGEST:
        return name
    return f"{name.encode()[: _LONGEST - 20].decode(errors='ignore')}%-{digests.of_bytes(node.encode())[:16]}"


def _recipe(project: Project, recipe: str) -> str:
    """`twin/scene` as it is; `g%2Fa` if there is a recipe `g`, whose node `a` has the folder `g/a`."""
    folders = project.recipe_folders()
    parts = [part.replace("%", "%25").replace("@", "%40") for part in recipe.split("/")]
    made = parts[0]
    for depth, part in enumerate(parts[1:], start=1):
        above = "/".join(recipe.split("/")[:depth])
        nests = any(os.path.isfile(folder / f"{above}.yaml") for folder in folders)
        made += f"{'%2F' if nests else '/'}{part}"
    return made
