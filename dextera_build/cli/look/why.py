"""`dxb why`: what a node's staleness comes from, down to the option, function or file that changed far upstream."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from dextera_build.cli import options, table
from dextera_build.report.wording import count

if TYPE_CHECKING:
    from dextera_build.session import Session


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("node", metavar="RECIPE[:NODE]", help="a node, or a recipe for all its stale nodes")
    options.project_arguments(parser)
    options.request_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print a sentence, then one cause a line: kind, name, old -> new, place; causes further upstream are indented."""
    session, node = options.session(args, args.node)
    if not node:
        return _recipe(session, as_json=args.json)
    from dextera_build.explain.why import explain

    sentence, causes = explain(session, node)
    from dextera_build.explain.origins import margin

    rows = [cause.to_json() for cause in causes]
    cells = [
        {
            "kind": margin(cause.depth + 1) + cause.kind,
            "name": cause.name,
            "change": cause.change,
            "place": cause.place,
        }
        for cause in causes
    ]
    if not args.json:
        print(sentence)
    return table.give({"node": args.node, "answer": sentence, "causes": rows}, as_json=args.json, cells=cells)


def _recipe(session: Session, *, as_json: bool) -> int:
    from dextera_build.cli.build import stale
    from dextera_build.session import addresses

    graph = session.plan().graph
    found, waiting = stale.show(session, graph, addresses(graph, ""), as_json=as_json)
    told = f"{count(len(found), 'node')} of {session.recipe} would run" if found else f"{session.recipe} is up to date"
    print(f"{told}, {waiting} may follow" if waiting else told, file=sys.stderr)
    return 0
