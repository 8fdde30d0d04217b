"""`dxb build`: bring targets up to date."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from dextera_build.building import build
from dextera_build.building.build import Order
from dextera_build.cli import options
from dextera_build.cli.build.shown import lines, stubs_of, suggest, tell
from dextera_build.cli.consoles import console
from dextera_build.runs import snapshot
from dextera_build.runs.snapshot import Recipe
from dextera_build.session import Session, addresses

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from dextera_build.building.build import Built
    from dextera_build.building.lock import Locking
    from dextera_build.project.planning import Added
    from dextera_build.project.project import Project
    from dextera_build.store.signature import Watch


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("targets", nargs="+", metavar="RECIPE[:TARGET]", help="twin/laptop_scene, or one node of it")
    options.build_arguments(parser)
    parser.add_argument(
        "--force", metavar="NODE", action="append", default=[], help="run this node even if it is cached"
    )
    parser.add_argument("--whole", action="store_true", help="download or rebuild the bytes of intermediate nodes, too")
    parser.add_argument("--check", action="store_true", help="run nothing; exit with 3 if a target is stale")
    parser.add_argument("--console", metavar="KIND", help="live, plain, jsonl or none (DXB_CONSOLE)")
    parser.add_argument("-v", "--verbose", action="store_true", help="also show the logs of nodes")
    parser.add_argument("--lock", action="store_true", help="pin the targets in dxb.lock")
    parser.add_argument("--locked", action="store_true", help="exit with 3 if a target differs from dxb.lock")
    text = "resources of this machine, instead of the measured ones: gpu=1,memory=16,licence:x=2 (DXB_RESOURCES)"
    parser.add_argument("--resources", metavar="NAME=AMOUNT,...", help=text)
    text = "where nodes run: local (default), ray, or ray:HOST:PORT, the head of a Ray cluster (DXB_EXECUTOR)"
    parser.add_argument("--executor", metavar="KIND", help=text)
    text = "answers of services: record (default: ask once), replay (ask never), refresh, replace or off (DXB_CALLS)"
    parser.add_argument("--calls", metavar="MODE", help=text)
    options.project_arguments(parser)
    options.request_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Build the named recipes, one after the other."""
    from dextera_build.building.lock import Locking
    from dextera_build.project.project import deciding_files
    from dextera_build.store.signature import Watch

    watch = Watch()
    for path in deciding_files():
        watch.file(path)
    project, added = options.project(args), options.added(args)
    _ = project.used_remotes  # wrong settings are refused even if nothing has to run
    locking = Locking(project, lock=args.lock, locked=args.locked, added=added)
    keeps = not (args.force or args.lock or args.locked or args.check or project.asks_again)
    keeps = keeps and project.console != "jsonl"
    if keeps and snapshot.answer(args.words, str(project.cache)):
        return 0
    code, answers, found = 0, "", list[Recipe]()
    wanted = options.by_recipe(args.targets)
    if len(wanted) > 1:
        _refuse_unknown(project, added, wanted)
    for recipe, targets in wanted.items():
        session = Session(project, recipe, added, makes=not args.check)
        order = Order(targets, args.keep_going, args.force, args.whole, tuple(sys.argv[1:]))
        if args.check:
            code = max(code, _check(session, order, locking))
            continue
        done = built(session, order, locking, watch if keeps else None, verbose=args.verbose)
        suggest(session, done)
        tell(done, quiet=project.console in ("none", "jsonl"))
        answers += lines(done.placed.paths)
        print(lines(done.placed.paths), end="")
        if done.ok:
            found.append(_said(session, done))
        code = max(code, 0 if done.ok else 1)
        if code and not args.keep_going:
            break
    if keeps and not code:
        snapshot.save(session.store.state, args.words, watch, found, answers, told=project.console != "none")
    return code


def _refuse_unknown(project: Project, added: Added, wanted: Mapping[str, Sequence[str]]) -> None:
    """Refuse recipes and targets that do not exist, before the first of several recipes is built."""
    for recipe, targets in wanted.items():
        graph = Session(project, recipe, added).plan(incomplete=True).graph
        for target in targets:
            addresses(graph, target)


def built(session: Session, order: Order, locking: Locking, watch: Watch | None, *, verbose: bool) -> Built:
    """Build, and build again once the user has consented to send the refused data."""
    from dextera_build.cli.build.consent import agreed

    while True:
        with console(session.project.console, sys.stderr, verbose=verbose) as shown:
            done = build.build(session, order, locking, shown, watch)
        if done.ok or not agreed(session.project, done):
            return done


def _said(session: Session, built: Built) -> Recipe:
    """A built recipe, as a snapshot records it."""
    nodes, root = built.result.nodes, session.store.actions.root
    keys = [nodes[node].key or "" for node in built.placed.paths]
    entries = [f"{root}/{key[:2]}/{key[2:]}" for key in keys]
    return Recipe(session.recipe, len(nodes), stubs_of(built), session.last_name, session.variant, entries)


def _check(session: Session, order: Order, locking: Locking) -> int:
    from dextera_build.cli.build.stale import check

    plan = session.plan()
    wanted = [address for target in order.targets for address in addresses(plan.graph, target)]
    locking.refuse(session, plan, wanted)
    return check("plan.check", session, plan.graph, wanted)
