"""`dxb why`: why a node is stale, down to the option, function or file that changed far upstream."""

from __future__ import annotations

import argparse

from dextera_build.cli import options, table
from dextera_build.session import addresses


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("node", metavar="RECIPE[:NODE]", help="a node, or a recipe for all its stale nodes")
    options.project_arguments(parser)
    options.request_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print a sentence and one line per cause: kind, name, old -> new, place; causes further upstream are indented."""
    session, node = options.session(args, args.node)
    if not node:
        from dextera_build.cli.build import stale

        graph = session.plan().graph
        return stale.check("why.recipe", session, graph, addresses(graph, ""), as_json=args.json, refuses=False)
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
    return table.give("why", {"node": args.node, "answer": sentence, "causes": rows}, as_json=args.json, cells=cells)
