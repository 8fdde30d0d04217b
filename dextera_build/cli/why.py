"""`dxb why`: what a node's staleness comes from, down to the option, function or file that changed far upstream."""

from __future__ import annotations

import argparse
import json
import sys
import time
from typing import TYPE_CHECKING

from dextera_build.cli import options, table
from dextera_build.errors import UsageError
from dextera_build.report.wording import count

if TYPE_CHECKING:
    from dextera_build.engine.dryrun import Planned
    from dextera_build.engine.graph import Graph
    from dextera_build.explain.causes import Cause
    from dextera_build.session import Session


def arguments(parser: argparse.ArgumentParser) -> None:
    """Fill in the parser."""
    parser.add_argument("node", metavar="RECIPE[:NODE]", help="a node, or a recipe for all its stale nodes")
    options.project_arguments(parser)
    options.request_arguments(parser)
    options.json_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Print a sentence, then one cause a line: kind, name, old -> new, place; what stands behind it stands indented."""
    from dextera_build.session import Session

    project = options.project(args)
    wanted = options.wish(args.node)
    session = Session(project, wanted.recipe, options.added(args))
    if not wanted.target:
        return _recipe(session, as_json=args.json)
    sentence, causes = explain(session, wanted.target)
    if args.json:
        rows = [cause.to_json() for cause in causes]
        print(json.dumps({"node": args.node, "answer": sentence, "causes": rows}, indent=1))
        return 0
    from dextera_build.explain.origins import margin

    print(sentence)
    table.show(
        [
            {
                "kind": margin(cause.depth + 1) + cause.kind,
                "name": cause.name,
                "change": cause.change,
                "place": cause.place,
            }
            for cause in causes
        ]
    )
    return 0


def _recipe(session: Session, *, as_json: bool) -> int:
    from dextera_build.cli import stale
    from dextera_build.session import addresses

    graph = session.plan().graph
    found, waiting = stale.show(session, graph, addresses(graph, ""), as_json=as_json)
    told = f"{count(len(found), 'node')} of {session.recipe} would run" if found else f"{session.recipe} is up to date"
    print(f"{told}, {waiting} may follow" if waiting else told, file=sys.stderr)
    return 0


def explain(session: Session, node: str) -> tuple[str, list[Cause]]:
    """A sentence about a node, and what changed.

    Raises:
        UsageError: `node` is not known yet.
    """
    from dextera_build.engine.dryrun import plan
    from dextera_build.session import addresses

    recipe = session.recipe
    graph = session.plan().graph
    found = plan(graph, addresses(graph, node), session.store, history=session.past_builds)
    states = {planned.address: planned for planned in found}
    if node not in states and session.past_builds.get(node) is None:
        raise UsageError(
            f"`{recipe}:{node}` is not known yet: its group is not open",
            code="DXB-U114",
            facts={"stale": ", ".join(name for name, planned in states.items() if planned.status == "stale")},
            hint=f"`dxb build '{recipe}:{node}'`",
        )
    return _explain(session, graph, states, node)


def _explain(session: Session, graph: Graph, states: dict[str, Planned], node: str) -> tuple[str, list[Cause]]:
    from dextera_build.explain.causes import Causes
    from dextera_build.session import NO_BYTES

    state = states.get(node)
    entry = session.past_builds.get(node)
    when = f"run {entry.run} ({_ago(entry.time)})" if entry else ""
    if state is not None and state.status == "cached":
        # The run in which it got this key: there it ran, was fetched, or was in the store already.
        since = f"since {when}" if entry and entry.key == state.key else "built by an earlier run or another recipe"
        again = session.store.divergent.get(state.key or "")
        outputs = f"; run again it gave another output, {again.again[-1][:12]} for {again.first[:12]}" if again else ""
        return f"up to date: key {(state.key or '')[:12]}, {since}{outputs}", []
    if state is not None and state.bare:
        maker = f", since {when}" if entry and entry.key == state.key else ""
        return f"its result is known: key {(state.key or '')[:12]}{maker}; {NO_BYTES}, a build brings or makes them", []
    causes = Causes(session, graph, states).of(node)
    if entry is None:
        return "never built", causes
    if state is None or not state.key_document:
        return f"may be stale: that is judged when its inputs are known; it was up to date in {when}", causes
    if state.key == entry.key:
        return f"up to date in {when}, but the store no longer holds it", []
    direct = sum(cause.depth == 0 for cause in causes)
    things = "1 thing it depends on" if direct == 1 else f"{direct} things it depends on"
    return f"stale: {things} changed since {when}", causes


def _ago(when: float) -> str:
    seconds = time.time() - when
    for size, name in ((86400, "day"), (3600, "hour"), (60, "minute")):
        if seconds >= size:
            count = int(seconds // size)
            return f"{count} {name}{'s' if count > 1 else ''} ago"
    return "a moment ago"
