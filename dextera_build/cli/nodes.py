"""The current state of a recipe's nodes, for `dxb ls`, `dxb plan` and `dxb show --graph`."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from dextera_build.errors import UsageError, did_you_mean, listing

if TYPE_CHECKING:
    from dextera_build.engine.dry import Planned
    from dextera_build.engine.graph import Address, Graph
    from dextera_build.explain.upstream import Upstream
    from dextera_build.project.project import Project
    from dextera_build.session import Session

Row = dict[str, Any]
"""Column -> text, or a number."""
_LABEL = re.compile(r"\[[^\]]*\]")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser of `dxb ls`."""
    group = parser.add_argument_group("nodes of recipes")
    way = group.add_mutually_exclusive_group()
    way.add_argument("--deps", action="store_true", help="list everything that these nodes depend on instead")
    way.add_argument("--rdeps", action="store_true", help="list everything that depends on these nodes instead")
    state = group.add_mutually_exclusive_group()
    state.add_argument("--stale", action="store_true", help="only nodes that a build would run, or may have to run")
    state.add_argument("--cached", action="store_true", help="only nodes that are up to date")


def planned(session: Session, graph: Graph, wanted: Sequence[Address] = ()) -> dict[str, Planned]:
    """Address -> effect of a build of `wanted` (default: all nodes) on the node, for each node needed."""
    from dextera_build.engine.dry import plan
    from dextera_build.engine.graph import Address

    targets = wanted or [Address(call) for call, _ in graph.calls()]
    return {node.address: node for node in plan(graph, targets, session.store, history=session.past_builds)}


def row(node: Planned, status: str = "") -> Row:
    """Address, status, rule, backend, duration of the last run [s], origin of the backend."""
    return {
        "node": node.address,
        "status": status or _status(node),
        "rule": node.rule.path,
        "backend": node.rule.backend,
        "last_seconds": node.seconds_last,
        "chosen": node.rule.chosen or None,
    }


def ranks(graph: Graph, wanted: Sequence[Address]) -> dict[tuple[str, ...], int]:
    """Call -> its place in the order of a build: behind everything that it reads."""
    found: dict[tuple[str, ...], int] = {}
    for target in wanted:
        stack = [(target.call, False)]
        while stack:
            call, is_read = stack.pop()
            if call in found:
                continue
            if is_read:
                found[call] = len(found)
            else:
                stack += [(call, True), *((need, False) for need in reversed(list(graph.needs(call))))]
    return found


def _status(node: Planned) -> str:
    if node.rule.missing and node.status != "cached":
        return "missing"
    return "bare" if node.bare and node.status == "cached" else node.status


def rows(project: Project, args: argparse.Namespace) -> Iterator[Row]:
    """One row per node that matches a glob, or per node that these depend on, or that depends on these.

    Raises:
        UsageError: No node matches.
    """
    from dextera_build.cli import options
    from dextera_build.engine.graph import Address, parse_address
    from dextera_build.explain.upstream import Upstream
    from dextera_build.project.planning import no_recipe
    from dextera_build.session import Session

    recipe, _, glob = args.what.partition(":")
    chosen = [address for address, _ in project.recipes() if _pattern(recipe).fullmatch(address)]
    if not chosen:
        raise no_recipe(project, recipe)
    seen: set[str] = set()
    matched = False
    for address in chosen:
        session = Session(project, address, options.added(args))
        try:
            graph = session.plan().graph
        except UsageError as error:
            # If the glob matches several recipes, skip those that need an input.
            if len(chosen) > 1 and error.code == "DXB-U105":
                continue
            raise
        nodes = planned(session, graph)
        order = ranks(graph, [Address(call) for call, _ in graph.calls()])
        nodes = dict(sorted(nodes.items(), key=lambda row: order.get(parse_address(row[0]).call, len(order))))
        seen |= nodes.keys()
        found = [name for name in nodes if _matches(name, glob or "*")]
        matched = matched or bool(found)
        if args.deps or args.rdeps:
            found = _reached(nodes, Upstream(graph, nodes), found, readers=args.rdeps)
        for name in found:
            is_hidden = args.stale if nodes[name].status == "cached" else args.cached
            if not is_hidden:
                yield row(nodes[name]) | {"node": f"{address}:{name}"}
    if not matched:
        calls = dict.fromkeys(_LABEL.sub("", name) for name in seen)
        raise UsageError(
            f"no node is called `{args.what}`",
            code="DXB-U173",
            facts={"nodes": listing(calls, most=40)},
            hint=did_you_mean(glob, [*seen, *calls]) or "`*` matches any characters",
        )


def _reached(nodes: Mapping[str, Planned], upstream: Upstream, start: Sequence[str], *, readers: bool) -> list[str]:
    """Dependencies of `start`, or its dependents, nearest first; nodes of `start` only if another one leads there."""
    ahead = {name: upstream.all_read_by(name) for name in nodes}
    if readers:
        ahead = {name: [reader for reader in nodes if name in ahead[reader]] for name in nodes}
    found: dict[str, None] = {}
    front = list(start)
    while front:
        front = [near for near in dict.fromkeys(near for far in front for near in ahead[far]) if near not in found]
        found |= dict.fromkeys(front)
    return list(found)


def _pattern(glob: str) -> re.Pattern[str]:
    """A glob as a regular expression: `*` matches any characters, `?` one; brackets are literal."""
    return re.compile("".join({"*": ".*", "?": "."}.get(c, re.escape(c)) for c in glob))


def _matches(address: str, glob: str) -> bool:
    """Whether a glob matches a node; a glob without labels matches every copy: `body.mesh`."""
    wanted = _pattern(glob)
    return bool(wanted.fullmatch(address) or wanted.fullmatch(_LABEL.sub("", address)))
