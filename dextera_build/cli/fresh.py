"""The no-op build: everything that a build depended on, by signature, so that nothing need be planned again."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from dextera_build import digest
from dextera_build.engine.snapshot import load_if_fresh
from dextera_build.engine.snapshot import save as save_snapshot
from dextera_build.store.signature import Watch

if TYPE_CHECKING:
    from dextera_build.engine.execute import RunResult
    from dextera_build.project import Project
    from dextera_build.recipe.plan import Plan
    from dextera_build.store.presence import Presence


def load(project: Project, fingerprint: Mapping[str, object]) -> tuple[str, tuple[str, ...]] | None:
    """How many nodes the same request had and the lines that it printed, if nothing it saw has changed since."""
    found = load_if_fresh(_file(project, fingerprint), dict(fingerprint))
    return (found.lines[0], found.lines[1:]) if found else None


def save(
    project: Project,
    fingerprint: Mapping[str, object],
    watch: Watch,
    presence: Presence,
    plan: Plan,
    result: RunResult,
    lines: list[str],
) -> None:
    """Remember a build that went well.

    A file that was changed after `watch` was made keeps the snapshot from being written, so it may be noted here.
    """
    from dextera_build.loader import bundled

    outputs = [Path(line.partition("\t")[2]).absolute() for line in lines]
    configuration = [project.root / name for name in ("dxb.toml", "dxb.local.toml", "pyproject.toml")]
    for file in (*plan.recipes, *project.library.code.files(), *configuration):
        watch.file(file)
    # A new rule, backend or recipe, an installed or upgraded package: all change the names in a folder.
    stages = [folder for root in project.library.roots for folder in (root.path, *root.path.iterdir())]
    for folder in (*stages, project.root / "recipes", bundled("recipes")):
        if folder.is_dir():
            watch.folder(folder)
    for entry in sys.path:
        watch.modules(entry or os.getcwd())
    watch.blobs(outputs)
    store = (str(project.cache), presence)
    save_snapshot(_file(project, fingerprint), dict(fingerprint), watch, [str(len(result.nodes)), *lines], store)


def _file(project: Project, fingerprint: Mapping[str, object]) -> Path:
    return project.cache / "local" / "snapshots" / digest.of_value(dict(fingerprint))[:32]
