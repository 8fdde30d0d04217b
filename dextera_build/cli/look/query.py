"""`dxb ls 'twin/*:body[*].mesh'`: nodes by glob, what they read, what reads them, and which of them are stale."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import TYPE_CHECKING

from dextera_build.errors import UsageError, did_you_mean, listing

if TYPE_CHECKING:
    from dextera_build.explain.nodes import Known
    from dextera_build.project.project import Project
    from dextera_build.session import Session

Row = dict[str, str]
_FILTERS = ("deps", "rdeps", "depth", "rule", "stale", "cached")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser of `dxb ls`."""
    group = parser.add_argument_group("nodes of recipes, as the last runs saw them")
    way = group.add_mutually_exclusive_group()
    way.add_argument("--deps", action="store_true", help="list their inputs instead")
    way.add_argument("--rdeps", action="store_true", help="list the nodes that read them instead")
    group.add_argument("--depth", metavar="N|all", help="depth of --deps and --rdeps: a number, or all (1)")
    group.add_argument("--rule", metavar="GLOB", help="only nodes of these rules: 'factorize.*'")
    state = group.add_mutually_exclusive_group()
    state.add_argument("--stale", action="store_true", help="only nodes that a build would run, or may have to run")
    state.add_argument("--cached", action="store_true", help="only nodes that are up to date")


def wants(args: argparse.Namespace) -> bool:
    """Whether the arguments ask for nodes, not for one of the plain listings."""
    return ":" in args.what or any(c in args.what for c in "*?") or any(getattr(args, name) for name in _FILTERS)


def rows(project: Project, args: argparse.Namespace) -> Iterator[Row]:
    """One row a node: address, rule, backend, status.

    Raises:
        UsageError: Nothing is called so.
    """
    from dextera_build.cli import options
    from dextera_build.explain import nodes as known
    from dextera_build.session import Session, no_recipe

    depth = _depth(args)
    recipe, _, node = args.what.partition(":")
    chosen = [address for address, _ in project.recipes() if known.pattern(recipe).fullmatch(address)]
    if not chosen:
        raise no_recipe(project, recipe)
    matched = False
    seen: dict[str, Known] = {}
    for address in chosen:
        session = Session(project, address, options.added(args))
        found = _nodes(session, several=len(chosen) > 1)
        start = known.matching(found, node or "*")
        seen |= found
        matched = matched or bool(start)
        yield from _rows(session, args, found, start, depth)
    if not matched:
        raise _nothing(args.what, seen)


def _depth(args: argparse.Namespace) -> int | None:
    if args.depth is not None and not (args.deps or args.rdeps):
        raise UsageError("`--depth` counts the steps of `--deps` or `--rdeps`", code="DXB-U174", hint="add one of them")
    if args.depth is None or args.depth == "all":
        return None if args.depth else 1
    if not args.depth.isdigit() or not int(args.depth):
        raise UsageError(f"`--depth` is a number of steps or `all`, not `{args.depth}`", code="DXB-U174")
    return int(args.depth)


def _nodes(session: Session, *, several: bool) -> dict[str, Known]:
    from dextera_build.explain import nodes as known

    found = known.of_runs(session.store, session.recipe)
    if found:
        return found
    try:
        return known.of_graph(session.plan().graph)
    except UsageError as error:
        # Of many recipes one may need an input that is not given; it has no nodes as long as it was not built.
        if several and error.code == "DXB-U105":
            return {}
        raise


def _rows(
    session: Session, args: argparse.Namespace, found: dict[str, Known], start: list[str], depth: int | None
) -> Iterator[Row]:
    from dextera_build.explain import nodes as known

    if args.deps or args.rdeps:
        start = known.walk(found, start, readers=args.rdeps, depth=depth)
    if args.rule:
        rule = known.pattern(args.rule)
        start = [address for address in start if rule.fullmatch(found[address].rule)]
    states = statuses(session) if start and (args.stale or args.cached) else None
    for address in start:
        node = found[address]
        status = node.status if states is None else states.get(address) or states.get(node.call, "")
        if states is None or (status and args.cached == (status == "cached")):
            yield {
                "node": f"{session.recipe}:{address}",
                "rule": node.rule,
                "backend": node.backend or "-",
                "status": status,
            }


def statuses(session: Session) -> dict[str, str]:
    """What a build of everything in the recipe would do with each node; see `dxb plan`."""
    from dextera_build.engine.dry import plan

    graph = session.plan().graph
    planned = plan(graph, [call for call, _ in graph.calls()], session.store)
    return {node.address: node.status for node in planned}


def _nothing(text: str, found: dict[str, Known]) -> UsageError:
    node = text.partition(":")[2]
    return UsageError(
        f"no node is called `{text}`",
        code="DXB-U173",
        facts={"nodes": listing(dict.fromkeys(one.call for one in found.values()), most=40)},
        hint=did_you_mean(node, [*found, *(one.call for one in found.values())]) or "`*` matches any characters",
    )
