"""`dxb build`: bring targets up to date."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from dextera_build import __version__
from dextera_build.cli import options
from dextera_build.errors import StaleError, StoreError, UsageError, listing

if TYPE_CHECKING:
    from dextera_build.cli.session import Session
    from dextera_build.engine.graph import Address
    from dextera_build.project import Project
    from dextera_build.recipe.plan import Plan


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("targets", nargs="+", metavar="RECIPE[:TARGET]", help="twin/laptop_scene, or one node of it")
    parser.add_argument("-k", "--keep-going", action="store_true", help="go on with what does not depend on a failure")
    parser.add_argument("-j", "--jobs", metavar="N", help="cores to share out; most nodes take one (DXB_JOBS)")
    parser.add_argument(
        "--force", metavar="NODE", action="append", default=[], help="run this node even if it is cached"
    )
    parser.add_argument("--check", action="store_true", help="run nothing; exit with 3 where something is stale")
    parser.add_argument("--console", metavar="KIND", help="live, plain, jsonl or none (DXB_CONSOLE)")
    parser.add_argument("-v", "--verbose", action="store_true", help="show what nodes log, too")
    options.project_arguments(parser)
    options.request_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Build every recipe that is named, one after the other."""
    started = time.perf_counter()
    project = options.project(args)
    wanted: dict[str, list[str]] = {}
    for text in args.targets:
        named = options.wish(text)
        wanted.setdefault(named.recipe, []).append(named.target)
    code = 0
    for recipe, targets in wanted.items():
        code = max(code, _build(args, project, recipe, targets, started))
        started = time.perf_counter()
        if code and not args.keep_going:
            break
    return code


def _build(args: argparse.Namespace, project: Project, recipe: str, targets: list[str], started: float) -> int:
    from dextera_build.cli import fresh

    fingerprint = {
        "dxb": __version__,
        "python": sys.version,
        "path": sys.path,
        "root": str(project.root),
        "recipe": recipe,
        "targets": targets,
        "profile": project.profile,
        "input": {text: os.path.abspath(text.partition("=")[2]) for text in args.input},
        "settings": args.settings,
        "backends": args.backends,
    }
    known = None if args.force else fresh.load(project, fingerprint)
    if known is not None:
        return _say_nothing_ran(project, recipe, *known, started)
    return _run(args, project, recipe, targets, fingerprint, started)


def _say_nothing_ran(project: Project, recipe: str, nodes: str, lines: Sequence[str], started: float) -> int:
    seconds = time.perf_counter() - started
    kind = project.config["console"].value
    if kind == "jsonl":
        from dextera_build.engine.events import RunFinished

        print(RunFinished(time.time(), True, seconds, {"cached": int(nodes)}, 0.0).to_line(), file=sys.stderr)
    elif kind != "none":
        print(f"{recipe} is up to date   {nodes} nodes   {seconds:.2f} s", file=sys.stderr)
    print("".join(line + "\n" for line in lines), end="")
    return 0


def _run(
    args: argparse.Namespace,
    project: Project,
    recipe: str,
    targets: list[str],
    fingerprint: dict[str, object],
    started: float,
    *,
    whole: bool = False,
) -> int:
    from dextera_build.cli import execution, fresh, results
    from dextera_build.cli.session import Session, addresses
    from dextera_build.engine.graph import Plan
    from dextera_build.store.cas import MissingBlob
    from dextera_build.store.presence import Presence
    from dextera_build.store.signature import Watch

    session = Session(project, recipe)
    seen = fresh.Seen(Watch(), Presence(str(session.store.root)))
    session.store.leaves.watch, session.store.actions.presence = seen.watch, seen.presence
    quick = not (whole or args.force or args.check or project.config["console"].value == "jsonl")
    near = fresh.near(project, fingerprint, session.store.leaves) if quick else None
    if near is not None and near.idle:
        nodes, *lines = near.stale.head["lines"]
        fresh.renew(project, fingerprint, seen, near, lines)
        return _say_nothing_ran(project, recipe, nodes, lines, started)
    plan = Plan(near.known.graph, ()) if near else session.plan(options.request(args, project.profile))
    wanted = [address for target in targets for address in addresses(plan.graph, target)]
    if args.check:
        return _check(session, plan, wanted)
    _refuse_unknown_force(args.force, plan)
    result = execution.execute(session, plan, wanted, args, near.known if near else None)
    try:
        lines = results.place(session, result)
    except StoreError as error:
        if error.code != MissingBlob.CODE:
            raise
        if near is not None:
            return _run(args, project, recipe, targets, fingerprint, started, whole=True)
        # A blob was damaged on disk; it has been put aside, so building again makes it anew.
        result = execution.execute(session, plan, wanted, args)
        lines = results.place(session, result)
    print("".join(line + "\n" for line in lines), end="")
    if result.ok and near is not None:
        fresh.renew(project, fingerprint, seen, near, lines)
    elif result.ok:
        fresh.save(project, fingerprint, seen, plan, result, lines)
    return 0 if result.ok else 1


def _check(session: Session, plan: Plan, wanted: list[Address]) -> int:
    from dextera_build.engine.dryrun import plan as dry

    nodes = dry(plan.graph, wanted, session.store)
    stale = [node.address for node in nodes if node.status == "stale"]
    if stale:
        raise StaleError(
            f"`{session.recipe}` is stale",
            code="DXB-C102",
            facts={"stale": listing(stale), "may follow": str(sum(node.status == "unknown" for node in nodes))},
            hint=f"`dxb why '{session.recipe}:{stale[0]}'`",
        )
    print(f"{session.recipe} is up to date", file=sys.stderr)
    return 0


def _refuse_unknown_force(names: list[str], plan: Plan) -> None:
    from dextera_build.cli.session import addresses

    for name in names:
        try:
            addresses(plan.graph, name.partition(":")[2] or name)
        except UsageError as error:
            error.message = f"`--force {name}`: {error.message}"
            raise
