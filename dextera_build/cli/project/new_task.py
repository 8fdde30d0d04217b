"""`dxb new task`: a recipe with tasks for the objects of a twin."""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from dextera_build.cli import options
from dextera_build.cli.project import written
from dextera_build.cli.table import writing
from dextera_build.errors import UsageError, listing
from dextera_build.project.planning import refuse_unknown

if TYPE_CHECKING:
    from dextera_build.artifacts.objects.object import Asset
    from dextera_build.artifacts.robots.robot import RobotModel
    from dextera_build.session import Session

_ROBOT = "robot/kuka_leap"
_ASSET = re.compile(r"body\[(.+)\]\.asset")
"""Nodes of the objects of a twin, and their labels."""


def run(args: argparse.Namespace) -> int:
    """Build the stale nodes of the twin, write the recipe, and print its path."""
    if not args.name:
        raise UsageError(
            "a task takes the recipe of its twin", code="DXB-U217", hint="`dxb new task twin/laptop_scene`"
        )
    from dextera_build.building import task_file

    session, node = options.session(args, args.name, makes=True)
    if node:
        raise UsageError(f"`{args.name}` is a node", code="DXB-U217", hint=f"`dxb new task {session.recipe}`")
    name = session.recipe.rpartition("/")[2]
    place = session.project.root.absolute() / "recipes" / "task" / f"{name}_tasks.yaml"
    out = Path(args.out) if args.out else place
    if out.exists():
        raise UsageError(f"`{out}` exists already", code="DXB-U191", hint="`-o FILE` writes to another file")
    assets = _assets(session)
    if assets is None:
        return 1
    robot, library = args.object or _ROBOT, session.project.library
    every = task_file.tasks(library, assets)
    model = _model(session, robot)
    if model is None:
        return 1
    if not task_file.has_arm(model):
        raise UsageError(
            f"{robot} has no arm: nothing takes its hand to an object",
            code="DXB-U214",
            hint="join it to an arm: `dxb new robot ARM HAND`",
        )
    found = every if task_file.holds(model) else [task for task in every if not task.proposal.holds]
    if not found:
        raise UsageError(f"no task is known for the objects of `{session.recipe}` and {robot}", code="DXB-U214")
    with writing(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(task_file.text(session.recipe, robot, assets, found, model))
    print(session.project.shown(out.absolute()))
    for task in found:
        print(f"  {task.proposal.name}: {task.primitive} `{task.object}`")
    if left := [task.proposal.name for task in every if task not in found]:
        print(f"  left out, because {robot} has no grip that holds: {listing(left)}", file=sys.stderr)
    made, first = written.address(session.project, out, place)
    print(f"  {first}keep the tasks that you want, check every marked guess, then: dxb build {made}", file=sys.stderr)
    once = task_file.shown(task_file.node(found[0]))
    print(f"  to see whether the robot does one, in a report: dxb build {made}:{once}", file=sys.stderr)
    print(
        "  to record demonstrations and train a policy, put one of them into a recipe with `extends: task/line`; "
        "`dxb plan task/line` lists its steps and the inputs that it needs",
        file=sys.stderr,
    )
    return 0


def _assets(session: Session) -> dict[str, Asset] | None:
    """Label -> object of a twin, built as far as they are stale; None if one failed."""
    from dextera_build.building import values
    from dextera_build.cli.consoles import console

    refuse_unknown(session.project, session.recipe)
    recipe = session.project.recipe(session.recipe)
    missing = [each for each in ("scene", "body", "ground") if recipe is None or each not in recipe.nodes]
    if missing:
        raise UsageError(
            f"`{session.recipe}` is no twin: it has no node `{missing[0]}`",
            code="DXB-U214",
            hint="name a recipe that extends twin/from_photo",
        )
    with console(session.project.console, sys.stderr, verbose=False) as shown:
        result = values.run(session, ("body.asset",), shown)
    if not result.ok:
        return None
    labels = {each: match.group(1) for each in result.nodes if (match := _ASSET.fullmatch(each))}
    assets = {label: values.value(session, result, each) for each, label in labels.items()}
    if not assets:
        raise UsageError(f"`{session.recipe}` has no objects", code="DXB-U214", hint="look at `dxb view`")
    return assets


def _model(session: Session, address: str) -> RobotModel | None:
    """A robot, built if it is stale; None if it failed.

    Raises:
        UsageError: The recipe has no robot.
    """
    from dextera_build.artifacts.robots.robot import RobotModel
    from dextera_build.building import values
    from dextera_build.cli.consoles import console
    from dextera_build.session import Session

    recipe, _, node = address.partition(":")
    refuse_unknown(session.project, recipe)
    robot = Session(session.project, recipe)
    with console(session.project.console, sys.stderr, verbose=False) as shown:
        result = values.run(robot, (node,), shown)
    if not result.ok:
        return None
    for each in reversed(list(result.nodes)):
        if node in ("", each) and ":" not in each:
            found = values.value(robot, result, each)
            if isinstance(found, RobotModel):
                return found
    raise UsageError(f"`{address}` is no robot", code="DXB-U214", hint="name a recipe below `robot/`")
