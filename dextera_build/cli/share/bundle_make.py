"""`dxb bundle create`: from what was built to a bundle."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from dextera_build import __version__
from dextera_build.bundle.config import Build, Contents
from dextera_build.bundle.export import Export
from dextera_build.cli import options, table
from dextera_build.errors import UsageError, listing

if TYPE_CHECKING:
    from dextera_build.bundle.closure_of_targets import Survey
    from dextera_build.project.project import Project
    from dextera_build.recipe.plan import Plan
    from dextera_build.session import Session


def create(args: argparse.Namespace) -> int:
    """Write a bundle; print its path, digest and size."""
    made = _make(args, args.targets)
    made.write(Path(args.out))
    return table.give([{"file": args.out, "digest": f"sha256:{made.digest}"}], as_json=args.json)


def _make(args: argparse.Namespace, targets: Sequence[str]) -> Export:
    from dextera_build.bundle import sign
    from dextera_build.session import reading

    project = options.project(args)
    builds: list[Build] = []
    recipes: dict[str, str] = {}
    times: list[float] = []
    for recipe, names in sorted(options.by_recipe(targets).items()):
        build, plan, past = _survey(args, project, recipe, names)
        builds.append(build)
        recipes |= _recipes(project, plan)
        times += past
    contents = Contents(args.closure, __version__, tuple(builds), recipes)
    made = Export(reading(project), contents, _created(times))
    if args.sign:
        signature, key = sign.seal(made.digest, Path(args.sign))
        made.attach(signature)
        print(f"signed with {key.id}", file=sys.stderr)
    return made


def _survey(
    args: argparse.Namespace, project: Project, recipe: str, names: Sequence[str]
) -> tuple[Build, Plan, list[float]]:
    """A build as it stands in the store, its plan, and when its targets were made."""
    from dextera_build.bundle.closure_of_targets import survey
    from dextera_build.session import Session, addresses

    session = Session(project, recipe, options.added(args))
    plan = session.plan()
    asked = [address for name in names for address in addresses(plan.graph, name)]
    found = survey(plan.graph, asked, session.store, args.closure, partial(_shown, project))
    if found.stale:
        wanted = " ".join(f"{recipe}:{name}" if name else recipe for name in names)
        raise UsageError(
            f"`{recipe}` is not built as it stands now",
            code="DXB-U142",
            facts={"stale": listing(found.stale)},
            hint=f"`dxb build {'--whole ' if args.closure == 'full' else ''}{wanted}`",
        )
    return Build(recipe, found.targets, project.profile, found.nodes), plan, _past(session, found)


def _past(session: Session, found: Survey) -> list[float]:
    known = [(session.past_builds.get(node.node), node) for node in found.nodes if node.node in found.targets]
    return [entry.time for entry, node in known if entry is not None and entry.key == node.key]


def _recipes(project: Project, plan: Plan) -> dict[str, str]:
    """Address -> YAML of every recipe that planning read."""
    known = {path.resolve(): address for address, path in project.recipes()}
    found = {}
    for path in plan.recipes:
        address = known.get(path.resolve())
        if address is not None:
            found[address] = path.read_bytes().decode()
    return found


def _created(times: Sequence[float]) -> str:
    """When this store came by the newest target, or what `SOURCE_DATE_EPOCH` says (https://reproducible-builds.org)."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    if epoch and not epoch.isdigit():
        raise UsageError(f"`SOURCE_DATE_EPOCH` is a number of seconds, not `{epoch}`", code="DXB-U145")
    seconds = float(epoch) if epoch else max(times, default=0.0)
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(seconds)) if seconds or epoch else ""


def _shown(project: Project, path: Path) -> str:
    """From the project's folder; of what lies elsewhere the name alone, as the rest is nobody's business."""
    return str(path.relative_to(project.root)) if path.is_relative_to(project.root) else path.name
