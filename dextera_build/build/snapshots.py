"""The no-op build: everything that a build depended on, by signature, so that nothing need be planned again."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dextera_build import digest
from dextera_build.engine import snapshot

if TYPE_CHECKING:
    from dextera_build.engine.execute import RunResult
    from dextera_build.engine.snapshot import Head
    from dextera_build.project import Project
    from dextera_build.recipe.plan import Plan
    from dextera_build.store.presence import Presence
    from dextera_build.store.signature import Watch


@dataclass(frozen=True)
class Seen:
    """What a build looks at."""

    watch: Watch
    presence: Presence


def load(project: Project, fingerprint: Mapping[str, object]) -> Head | None:
    """What is remembered of the same request, if nothing that it rests on has changed since.

    Its `lines` are the number of nodes and what it printed.
    """
    return snapshot.load_if_fresh(place(project, fingerprint), dict(fingerprint))


def save(
    project: Project, fingerprint: Mapping[str, object], seen: Seen, plan: Plan, result: RunResult, lines: list[str]
) -> Head | None:
    """Remember a build that went well; None where that cannot be.

    A file that was changed after `seen` was made keeps the snapshot from being written, so it may be noted here.
    """
    outputs = _placed(lines)
    watch, path = seen.watch, place(project, fingerprint)
    note(project, watch, plan)
    watch.blobs(outputs)
    store = (str(project.cache), seen.presence)
    return snapshot.save(path, dict(fingerprint), watch, [str(len(result.nodes)), *lines], store)


def note(project: Project, watch: Watch, plan: Plan) -> None:
    """Note what planning read: recipes, code, configuration, and folders in which a new one would lie.

    Packages that are installed are noted, too.
    """
    from dextera_build.code.loader import bundled

    configuration = [project.root / name for name in ("dxb.toml", "dxb.local.toml", "pyproject.toml")]
    for file in (*plan.recipes, *project.library.code.files(), *configuration):
        watch.file(file)
    # A new rule, backend or recipe: all change the names in a folder.
    for folder in (*project.library.folders(), project.root / "recipes", bundled("recipes")):
        if folder.is_dir():
            watch.folder(folder)
    note_packages(watch)


def note_packages(watch: Watch) -> None:
    """Note what can be imported, and which packages are installed."""
    for entry in sys.path:
        watch.modules(entry or os.getcwd())


def told(lines: Sequence[str]) -> str:
    """What a build prints of what it placed: paths below the current folder are relative to it."""
    here = f"{os.getcwd()}/"
    text = "".join([f"{line}\n" for line in lines])
    if text.count("\t") == len(lines):  # no path has one
        return text.replace(f"\t{here}", "\t")
    said = (line.partition("\t") for line in lines)
    return "".join(f"{node}\t{path.removeprefix(here)}\n" for node, _, path in said)


def _placed(lines: list[str]) -> list[str]:
    return [line.partition("\t")[2] for line in lines]


def place(project: Project, fingerprint: Mapping[str, object]) -> Path:
    """Where a request is remembered."""
    # Pins change with what is built; the request is the same.
    locking = fingerprint.get("lock")
    asked = {**fingerprint, "lock": locking[:2] if isinstance(locking, list) else None}
    return project.cache / "local" / "snapshots" / digest.of_value(asked)[:32]
