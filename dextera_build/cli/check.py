"""`dxb check`: recipes without building them, or one node built again and compared."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from dextera_build.cli import options
from dextera_build.errors import DxbError, RuleError, UsageError

if TYPE_CHECKING:
    from dextera_build.project import Project


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument(
        "targets",
        nargs="*",
        metavar="RECIPE[:NODE]",
        help="recipes to resolve (all of them without any), or a node to build again and compare",
    )
    options.project_arguments(parser)
    options.request_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Print one line per recipe; 2 where one is wrong, 1 where a rebuilt node differs."""
    project = options.project(args)
    code = 0
    for target in args.targets or [address for address, _ in project.recipes()]:
        named = options.wish(target)
        try:
            recipe, node = named.recipe, named.target
            found = _repeat(args, project, recipe, node) if node else _resolve(args, project, recipe)
            print(f"{target}\t{found}")
        except DxbError as error:
            if args.targets and len(args.targets) == 1:
                raise
            from dextera_build.cli.errors import render

            print(render(error), file=sys.stderr)
            code = max(code, error.exit_code)
    return code


def _resolve(args: argparse.Namespace, project: Project, recipe: str) -> str:
    from dextera_build.cli.session import Session

    try:
        graph = Session(project, recipe).plan(options.request(args, project.profile)).graph
    except UsageError as error:
        if error.code != "DXB-U105":
            raise
        return f"sound, needs an input: {error.message}"
    return f"sound, {len(list(graph.calls()))} calls"


def _repeat(args: argparse.Namespace, project: Project, recipe: str, node: str) -> str:
    """Run one node on the inputs of its last build, beside the cache."""
    from dextera_build.cli.session import Session
    from dextera_build.runner import run_task

    session = Session(project, recipe)
    before, document = session.output(node), session.document(node)
    task = {
        "rule": document["rule"],
        "backend": document["backend"],
        "options": document["options"],
        "inputs": dict(document["inputs"]),
        "store": str(project.cache),
        "project": str(project.root),
    }
    after = run_task(task, lambda kind, data: None)["output"]
    if after != before:
        raise RuleError(
            f"`{recipe}:{node}` is not deterministic: built again, it came out different",
            code="DXB-B402",
            facts={"first": before, "again": after},
            hint="look for random numbers, threads, time or hash order in the rule",
        )
    return f"same output again: {after}"
