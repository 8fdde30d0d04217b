"""`dxb build`: bring targets up to date."""

from __future__ import annotations

import argparse
import os
import sys
import time
from typing import TYPE_CHECKING

from dextera_build import __version__
from dextera_build.cli import locking, options
from dextera_build.errors import StoreError, UsageError

if TYPE_CHECKING:
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
    locking.arguments(parser)
    options.resources_argument(parser)
    options.calls_argument(parser)
    options.project_arguments(parser)
    options.request_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Build every recipe that is named, one after the other."""
    started = time.perf_counter()
    project = options.project(args)
    plain = not (args.input or args.settings or args.backends)
    args.locking = locking.Locking(project, lock=args.lock, locked=args.locked, plain=plain)
    code = 0
    try:
        for recipe, targets in options.by_recipe(args.targets).items():
            code = max(code, _build(args, project, recipe, targets, started))
            started = time.perf_counter()
            if code and not args.keep_going:
                break
    finally:
        notice = args.locking.write()
        if notice and project.config["console"].value not in ("none", "jsonl"):
            print(notice, file=sys.stderr)
    return code


def _build(args: argparse.Namespace, project: Project, recipe: str, targets: list[str], started: float) -> int:
    from dextera_build.cli import fresh

    fingerprint = {
        "dxb": __version__,
        "python": sys.version,
        "root": str(project.root),
        "recipe": recipe,
        "targets": targets,
        "profile": project.profile,
        "input": {text: os.path.abspath(text.partition("=")[2]) for text in args.input},
        "settings": args.settings,
        "backends": args.backends,
        "lock": args.locking.state(recipe),
    }
    known = None if args.force or project.calls in ("refresh", "replace") else fresh.load(project, fingerprint)
    if known is not None:
        nodes, lines = known
        _say_nothing_ran(project, recipe, nodes, time.perf_counter() - started)
        print("".join(line + "\n" for line in lines), end="")
        return 0
    return _run(args, project, recipe, targets, fingerprint)


def _say_nothing_ran(project: Project, recipe: str, nodes: str, seconds: float) -> None:
    kind = project.config["console"].value
    if kind == "jsonl":
        from dextera_build.engine.events import RunFinished

        print(RunFinished(time.time(), True, seconds, {"cached": int(nodes)}, 0.0).to_line(), file=sys.stderr)
    elif kind != "none":
        print(f"{recipe} is up to date   {nodes} nodes   {seconds:.2f} s", file=sys.stderr)


def _run(
    args: argparse.Namespace, project: Project, recipe: str, targets: list[str], fingerprint: dict[str, object]
) -> int:
    from dextera_build.cli.session import Session, addresses
    from dextera_build.store.cas import MissingBlob
    from dextera_build.store.signature import Watch

    session = Session(project, recipe)
    session.store.leaves.watch = watch = Watch()
    plan = session.plan(options.request(args, project.profile))
    wanted = [address for target in targets for address in addresses(plan.graph, target)]
    args.locking.refuse(session, plan, wanted)
    if args.check:
        from dextera_build.cli import stale

        return stale.check(session, plan.graph, wanted)
    _refuse_unknown_force(args.force, plan)
    from dextera_build.cli import execution, fresh, results

    # Until its results are placed nobody may collect them.
    with session.store.running.announced():
        result = execution.execute(session, plan, wanted, args)
        if result.ok:
            args.locking.refuse(session, plan, wanted)
        try:
            lines = results.place(session, result)
        except StoreError as error:
            if error.code != MissingBlob.CODE:
                raise
            # A blob was damaged on disk. All such are set aside, so building again makes them anew.
            for node in result.targets:
                session.store.actions.verify(result.nodes[node].key or "")
            result = execution.execute(session, plan, wanted, args)
            lines = results.place(session, result)
    print("".join(line + "\n" for line in lines), end="")
    if result.ok:
        args.locking.note(session, plan, wanted, result)
        fingerprint["lock"] = args.locking.state(recipe)
        fresh.save(project, fingerprint, watch, plan, result, lines)
    return 0 if result.ok else 1


def _refuse_unknown_force(names: list[str], plan: Plan) -> None:
    from dextera_build.cli.session import addresses

    for name in names:
        try:
            addresses(plan.graph, name.partition(":")[2] or name)
        except UsageError as error:
            error.message = f"`--force {name}`: {error.message}"
            raise
