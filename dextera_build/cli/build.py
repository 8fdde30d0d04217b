"""`dxb build`: bring targets up to date."""

from __future__ import annotations

import argparse
import sys
import time
from typing import TYPE_CHECKING

from dextera_build.build import build, snapshots
from dextera_build.build.build import Order
from dextera_build.cli import options
from dextera_build.cli.shown import Shown, lines, tell
from dextera_build.session import Session, addresses

if TYPE_CHECKING:
    from dextera_build.build.build import Built
    from dextera_build.build.lock import Locking
    from dextera_build.cli.notes import Notes


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
    from dextera_build.build.lock import Locking
    from dextera_build.cli.notes import Notes

    started = time.perf_counter()
    notes = Notes(args.words)
    project, added = options.project(args), options.added(args)
    project.refuse_wrong_settings()
    locking = Locking(project, lock=args.lock, locked=args.locked, added=added)
    code = 0
    recipes = options.by_recipe(args.targets)
    for recipe, targets in recipes.items():
        session = Session(project, recipe, added, makes=not args.check)
        code = max(code, _build(args, session, _order(args, targets), locking, notes, started))
        started = time.perf_counter()
        if code and not args.keep_going:
            break
    kind = project.console
    if not (code or args.force or args.lock or args.locked or project.asks_again or kind == "jsonl"):
        notes.write(len(recipes), told=kind != "none")
    return code


def _order(args: argparse.Namespace, targets: list[str]) -> Order:
    return Order(targets, args.keep_going, args.force, args.whole, tuple(sys.argv[1:]))


def _build(
    args: argparse.Namespace, session: Session, order: Order, locking: Locking, notes: Notes, started: float
) -> int:
    kind = session.project.console
    built = build.answer(session, order, locking)
    if built is not None:
        _say_nothing_ran(session, built, time.perf_counter() - started)
    elif args.check:
        return _check(session, order, locking)
    else:
        with Shown(kind, verbose=args.verbose) as shown:
            built = build.build(session, order, locking, shown)
    notes.add(session, snapshots.place(session, order, locking), built.head)
    tell(built, quiet=kind in ("none", "jsonl"))
    print(lines(built.placed.paths), end="")
    return 0 if built.ok else 1


def _check(session: Session, order: Order, locking: Locking) -> int:
    from dextera_build.cli.stale import check

    plan = session.plan()
    wanted = [address for target in order.targets for address in addresses(plan.graph, target)]
    locking.refuse(session, plan, wanted)
    return check(session, plan.graph, wanted)


def _say_nothing_ran(session: Session, built: Built, seconds: float) -> None:
    kind = session.project.console
    if kind == "jsonl":
        from dextera_build.engine.events import RunFinished

        print(RunFinished(time.time(), True, seconds, {"cached": built.nodes}, 0.0).to_line(), file=sys.stderr)
    elif kind != "none":
        many = "s" * (built.nodes != 1)
        print(f"{session.recipe} is up to date   {built.nodes} node{many}   {seconds:.2f} s", file=sys.stderr)
