"""`dxb build`: bring targets up to date."""

from __future__ import annotations

import argparse
import os
import sys
import time
from typing import TYPE_CHECKING

from dextera_build import __version__
from dextera_build.build import lock as locking
from dextera_build.cli import options
from dextera_build.errors import StoreError, UsageError

if TYPE_CHECKING:
    from dextera_build.engine.graph import Address
    from dextera_build.engine.records import RunResult
    from dextera_build.engine.snapshot import Head
    from dextera_build.project import Project
    from dextera_build.recipe.plan import Plan
    from dextera_build.session import Session


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("targets", nargs="+", metavar="RECIPE[:TARGET]", help="twin/laptop_scene, or one node of it")
    parser.add_argument("-k", "--keep-going", action="store_true", help="go on with what does not depend on a failure")
    parser.add_argument("-j", "--jobs", metavar="N", help="cores to share out; most nodes take one (DXB_JOBS)")
    parser.add_argument(
        "--force", metavar="NODE", action="append", default=[], help="run this node even if it is cached"
    )
    parser.add_argument("--whole", action="store_true", help="also the bytes of nodes that nobody has to read")
    parser.add_argument("--check", action="store_true", help="run nothing; exit with 3 where something is stale")
    parser.add_argument("--console", metavar="KIND", help="live, plain, jsonl or none (DXB_CONSOLE)")
    parser.add_argument("-v", "--verbose", action="store_true", help="show what nodes log, too")
    parser.add_argument("--lock", action="store_true", help="pin the targets in dxb.lock")
    parser.add_argument("--locked", action="store_true", help="exit with 3 where a target is not what dxb.lock says")
    options.resources_argument(parser)
    options.executor_argument(parser)
    options.calls_argument(parser)
    options.project_arguments(parser)
    options.request_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Build every recipe that is named, one after the other."""
    from dextera_build.cli.notes import Notes

    started = time.perf_counter()
    args.notes = Notes(args.words)
    project = options.project(args)
    project.refuse_wrong_settings()
    args.locking = locking.Locking(project, lock=args.lock, locked=args.locked, added=options.added(args))
    code = 0
    recipes = options.by_recipe(args.targets)
    try:
        for recipe, targets in recipes.items():
            code = max(code, _build(args, project, recipe, targets, started))
            started = time.perf_counter()
            if code and not args.keep_going:
                break
    finally:
        notice = args.locking.write()
        if notice and project.console not in ("none", "jsonl"):
            print(notice, file=sys.stderr)
    kind = project.console
    if not (code or args.force or args.lock or args.locked or project.asks_again or kind == "jsonl"):
        args.notes.write(len(recipes), told=kind != "none")
    return code


def _build(args: argparse.Namespace, project: Project, recipe: str, targets: list[str], started: float) -> int:
    from dextera_build.build import snapshots as fresh

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
        "whole": args.whole,
        "lock": args.locking.state(recipe),
    }
    head = None if args.force or project.asks_again else fresh.load(project, fingerprint)
    if head is not None:
        args.notes.add(recipe, fresh.place(project, fingerprint), head)
        return _say_nothing_ran(project, recipe, head, started)
    return _run(args, project, recipe, targets, fingerprint)


def _say_nothing_ran(project: Project, recipe: str, head: Head, started: float) -> int:
    from dextera_build.build import snapshots as fresh

    nodes, *lines = head["lines"]
    seconds = time.perf_counter() - started
    kind = project.console
    if kind == "jsonl":
        from dextera_build.engine.events import RunFinished

        print(RunFinished(time.time(), True, seconds, {"cached": int(nodes)}, 0.0).to_line(), file=sys.stderr)
    elif kind != "none":
        print(f"{recipe} is up to date   {nodes} node{'s' * (nodes != '1')}   {seconds:.2f} s", file=sys.stderr)
    print(fresh.told(lines), end="")
    return 0


def _run(
    args: argparse.Namespace, project: Project, recipe: str, targets: list[str], fingerprint: dict[str, object]
) -> int:
    """Plan a recipe and build it."""
    from dextera_build.build import snapshots as fresh
    from dextera_build.session import Session, addresses
    from dextera_build.store.presence import Presence
    from dextera_build.store.signature import Watch

    session = Session(project, recipe, makes=not args.check)
    seen = fresh.Seen(Watch(), Presence(str(session.store.root)))
    session.store.leaves.watch, session.store.actions.presence = seen.watch, seen.presence
    place = fresh.place(project, fingerprint)
    plan = session.plan(options.request(args, project.profile))
    wanted = [address for target in targets for address in addresses(plan.graph, target)]
    args.locking.refuse(session, plan, wanted)
    if args.check:
        from dextera_build.cli.stale import check

        return check(session, plan.graph, wanted)
    _refuse_unknown_force(args.force, plan)
    result, lines = _make(args, session, plan, wanted)
    print(fresh.told(lines), end="")
    if result.ok:
        args.locking.note(session, plan, wanted, result)
        fingerprint["lock"] = args.locking.state(recipe)
        args.notes.add(recipe, place, fresh.save(project, fingerprint, seen, plan, result, lines))
    return 0 if result.ok else 1


def _make(args: argparse.Namespace, session: Session, plan: Plan, wanted: list[Address]) -> tuple[RunResult, list[str]]:
    """Build, and place what was asked for."""
    from dextera_build.build import export as results
    from dextera_build.cli import execution
    from dextera_build.store.cas import MissingBlob

    # Until its results are placed nobody may collect them.
    with session.store.running.announced():
        result = execution.execute(session, plan, wanted, args)
        if result.ok:
            args.locking.refuse(session, plan, wanted)
        try:
            return result, results.place(session, result)
        except StoreError as error:
            if error.code != MissingBlob.CODE:
                if any(failed.code == error.code for failed in result.errors.values()):
                    return result, []  # a node failed of the same, and that was said
                raise
            # A blob was damaged on disk. All such are set aside, so building again makes them anew.
            for node in result.targets:
                session.store.actions.verify(result.nodes[node].key or "")
            result = execution.execute(session, plan, wanted, args)
            return result, results.place(session, result)


def _refuse_unknown_force(names: list[str], plan: Plan) -> None:
    from dextera_build.session import addresses

    for name in names:
        try:
            addresses(plan.graph, name.partition(":")[2] or name)
        except UsageError as error:
            error.message = f"`--force {name}`: {error.message}"
            raise
