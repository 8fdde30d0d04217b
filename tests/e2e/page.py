"""Pages of the docs whose files are written into a project, and what becomes stale by them."""

from __future__ import annotations

import re
from pathlib import Path

import dextera_build
from dextera_build.project.project import Project
from dextera_build.recipe.plan import Plan, Request, plan
from dextera_build.recipe.profiles import Profile
from tests.e2e.space import Space

DOCS = Path(dextera_build.__file__).parent / "docs"


def blocks(page: str, kind: str) -> list[str]:
    """Code blocks of one language on a page."""
    text = (DOCS / f"{page}.md").read_text()
    return re.findall(rf"^```{kind}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def planned(space: Space, address: str) -> Plan:
    """The plan of a recipe with stubs."""
    project = Project(space.root)
    return plan(address, project.recipe, project.library, project.root, Request(Profile("stub", {})))


def stale(before: Plan, after: Plan) -> set[str]:
    """Calls of which the key holds something else."""
    old = {path: (call.rule, call.options, call.inputs) for path, call in before.graph.calls()}
    new = {path: (call.rule, call.options, call.inputs) for path, call in after.graph.calls()}
    return {".".join(path) for path in old.keys() | new.keys() if old.get(path) != new.get(path)}
