"""`dxb show --graph`: the nodes of a recipe and their inputs, as SVG, JSON or Graphviz DOT."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import TYPE_CHECKING

from dextera_build.cli import nodes, options, table
from dextera_build.report.collapse import WAYS
from dextera_build.session import addresses

if TYPE_CHECKING:
    from dextera_build.report.run import Node
    from dextera_build.session import Session


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser of `dxb show`."""
    group = parser.add_argument_group("with --graph")
    group.add_argument("--dot", action="store_true", help="print the graph in Graphviz' language instead of SVG")
    group.add_argument("--by", choices=WAYS, default="node", help="draw one box per node, group, rule or recipe (node)")
    group.add_argument("--status", action="store_true", help="mark what a build would do with each node")


OTHERS = {"svg": (".dot", ".gv", ".png", ".jpg", ".pdf"), "dot": (".svg", ".png", ".jpg", ".pdf")}
"""Form in which a graph is written -> suffixes of files that have another form."""


def used(args: argparse.Namespace) -> Iterator[str]:
    """The flags of a graph that are given."""
    yield from (f"--{name}" for name in ("dot", "status") if getattr(args, name))
    yield from ["--by"] if args.by != WAYS[0] else []


def run(args: argparse.Namespace) -> int:
    """Print the graph, or write it and print its path."""
    session, target = options.session(args, args.target)
    found = _nodes(session, target, marked=args.status)
    text = _written(args, session.recipe, target, found)
    return table.give_text(session.project, text, args.out, as_json=args.json)


def _nodes(session: Session, target: str, *, marked: bool) -> list[Node]:
    """The nodes that a target needs, with their inputs, as the report draws them."""
    from dextera_build.explain.upstream import Upstream
    from dextera_build.report.run import Node

    graph = session.plan().graph
    found = nodes.planned(session, graph, addresses(graph, target) if target else ())
    upstream = Upstream(graph, found)
    return [
        Node(index, address, node.rule.path, node.rule.backend, node.status if marked else "", None, None, 0.0, 0.0,
             depends_on=upstream.all_read_by(address))
        for index, (address, node) in enumerate(found.items())
    ]  # fmt: skip


def _written(args: argparse.Namespace, recipe: str, target: str, drawn: list[Node]) -> str:
    from dextera_build.report import collapse, drawing

    boxes = collapse.collapse(drawn, args.by)
    title = f"{recipe}:{target}" if target else recipe
    if not args.json:
        return drawing.dot(title, boxes) if args.dot else drawing.svg(title, boxes)
    rows, members = [], collapse.members(drawn, args.by)
    for box in boxes:
        inside = members[box.address]
        alike = {name: {getattr(node, name) for node in inside} for name in ("rule", "backend")}
        same = {name: values.pop() if len(values) == 1 else None for name, values in alike.items()}
        rows.append({"id": box.address, **same, "status": box.status or None, "count": len(inside)})
    edges = [{"from": source, "to": box.address} for box in boxes for source in box.depends_on]
    told = {"recipe": recipe, "target": target or None, "by": args.by, "nodes": rows, "edges": edges}
    return table.spelled("show.graph", told, indent=1)
