"""Example inputs of a rule: those that a recipe gives it, built with the profile `stub`."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.core.forms import type_among
from dextera_build.building import build as building
from dextera_build.building.lock import Locking
from dextera_build.code.loader import RuleFile
from dextera_build.errors import DxbError, UsageError
from dextera_build.project.planning import Added
from dextera_build.project.project import Project
from dextera_build.session import Session

_UNPINNED = Added(backends={"": "stub"})
"""A build with additions leaves the project's lock file alone."""


def of(found: RuleFile, project: Path, folder: Path) -> tuple[dict[str, Artifact], dict[str, Any]]:
    """Slot -> artifact, and the options of a rule; see `testing.RuleRunner.example`.

    Args:
        found: The rule.
        project: The folder of the project.
        folder: Takes the store of the build.
    """
    here = Project(project, {"cache": str(folder), "profile": "stub"})
    for session, node in _calls(here, found.path):
        built = building.build(
            session,
            building.Order((node,)),
            Locking(here, lock=False, locked=False, added=_UNPINNED),
            lambda event: None,
        )
        for error in built.result.errors.values():
            raise error
        record = next(each for each in built.result.nodes.values() if each.rule == found.path and each.key)
        document = json.loads(session.store.reader(str(record.key)))
        reader, slots = session.store.reader, found.rule.slots
        inputs = {
            slot: type_among(slots[slot].annotation, key, reader).decode(key, reader)
            for slot, key in document["inputs"]
        }
        options = {name: value for name, value in document["options"].items() if name not in found.backends}
        return inputs, options
    raise UsageError(
        f"no recipe calls `{found.path}`",
        code="DXB-U198",
        hint="write one below `recipes/`, or give `RuleRunner.run` inputs of your own",
    )


def _calls(project: Project, rule: str) -> Iterator[tuple[Session, str]]:
    """Calls of a rule, by recipe, without recipes that need inputs or cannot be planned here."""
    for name, _ in project.recipes():
        session = Session(project, name, makes=True)
        try:
            calls = list(session.plan().graph.calls())
        except DxbError:
            continue
        for address, call in calls:
            if call.rule.path == rule:
                yield session, ".".join(address)
