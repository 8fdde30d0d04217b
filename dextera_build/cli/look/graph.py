"""`dxb show --graph`: the nodes of a recipe and what they read, as SVG, JSON or Graphviz DOT."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from typing import TYPE_CHECKING

from dextera_build.cli import options
from dextera_build.cli.look.output import give
from dextera_build.errors import UsageError, listing

if TYPE_CHECKING:
    from dextera_build.engine.graph import Graph
    from dextera_build.explain.nodes import Known
    from dextera_build.report.run import Node
    from dextera_build.session import Session


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser of `dxb show`."""
    group = parser.add_argument_group("with --graph")
    group.add_argument("--dot", action="store_true", help="print the graph in Graphviz' language instead of SVG")
    group.add_argument("--by", metavar="WHAT", default="node", help="a box for each node, group, rule or recipe (node)")
    group.add_argument("--status", action="store_true", help="mark what a build would do with each node")


def run(args: argparse.Namespace) -> int:
    """Print the graph, or write it and print its path.

    The JSON has `recipe`, `target`, `by`, `nodes` (`id`, `rule`, `backend`, `status`: null without `--status`; `count`:
    how many nodes it stands for; rule and backend are null where these are not one) and `edges` (`from`, `to`: ids;
    `to` reads what `from` returns).
    """
    from dextera_build.report.collapse import WAYS

    if args.by not in WAYS:
        raise UsageError(
            f"`--by {args.by}` is not a way to draw a graph", code="DXB-U176", facts={"ways": listing(WAYS)}
        )
    session, target = options.session(args, args.target)
    nodes = _nodes(session, target, args)
    return give(session.project, _written(args, session.recipe, target, nodes), args.out)


def _nodes(session: Session, target: str, args: argparse.Namespace) -> list[Node]:
    from dextera_build.cli.look import query
    from dextera_build.explain import nodes as known
    from dextera_build.report.run import Node

    found = known.of_runs(session.store, session.recipe)
    try:
        graph = session.plan().graph
    except UsageError as error:
        # An input is not given; what the runs saw with one can be drawn all the same.
        if error.code != "DXB-U105" or not found or target or args.status:
            raise
    else:
        found = _planned(graph, found)
        if target:
            found = _below(graph, found, target)
    states = query.statuses(session) if args.status else {}
    return [
        Node(index, node.address, node.rule, node.backend, _state(states, node), None, None, 0.0, 0.0,
             depends_on=_sources(found, node))
        for index, node in enumerate(found.values())
    ]  # fmt: skip


def _planned(graph: Graph, found: dict[str, Known]) -> dict[str, Known]:
    """The calls of a plan, with the copies that past runs saw."""
    from dextera_build.explain import nodes as known

    planned = known.of_graph(graph)
    calls = {node.call for node in planned.values()}
    kept = {address: node for address, node in found.items() if node.call in calls}
    seen = {node.call for node in kept.values()}
    return kept | {address: node for address, node in planned.items() if node.call not in seen}


def _below(graph: Graph, found: dict[str, Known], target: str) -> dict[str, Known]:
    from dextera_build.explain import nodes as known
    from dextera_build.session import addresses

    start = [one for address in addresses(graph, target) for one in known.matching(found, str(address))]
    below = {*start, *known.walk(found, start, readers=False, depth=None)}
    return {address: node for address, node in found.items() if address in below}


def _sources(found: Mapping[str, Known], node: Known) -> list[str]:
    """What it reads; where one of both is known without labels, all that its call stands for."""
    sources: list[str] = []
    for source in node.depends_on:
        bare = source.replace("[*]", "")
        sources += [source] if source in found else [other for other, one in found.items() if one.call == bare]
    return sources


def _state(states: Mapping[str, str], node: Known) -> str:
    return states.get(node.address) or states.get(node.call) or ("unknown" if states else "")


def _written(args: argparse.Namespace, recipe: str, target: str, nodes: list[Node]) -> str:
    from dextera_build.report import collapse, drawing

    boxes = collapse.collapse(nodes, args.by)
    title = f"{recipe}:{target}" if target else recipe
    if args.dot:
        return drawing.dot(title, boxes)
    if not args.json:
        return drawing.svg(title, boxes)
    inside = collapse.members(nodes, args.by)
    rows = [
        {
            "id": box.address,
            "rule": _same({node.rule for node in inside[box.address]}),
            "backend": _same({node.backend for node in inside[box.address]}),
            "status": box.status or None,
            "count": len(inside[box.address]),
        }
        for box in boxes
    ]
    edges = [{"from": source, "to": box.address} for box in boxes for source in box.depends_on]
    return json.dumps({"recipe": recipe, "target": target, "by": args.by, "nodes": rows, "edges": edges}, indent=1)


def _same(values: set[str] | set[str | None]) -> str | None:
    return next(iter(values)) if len(values) == 1 else None
