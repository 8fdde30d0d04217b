"""Why a node is stale, or when it was built: one sentence, and the causes."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from dextera_build.errors import UsageError

if TYPE_CHECKING:
    from dextera_build.engine.dry import Planned
    from dextera_build.engine.graph import Graph
    from dextera_build.explain.causes import Cause
    from dextera_build.session import Session


def explain(session: Session, node: str) -> tuple[str, list[Cause]]:
    """A sentence about a node, and what changed.

    Raises:
        UsageError: `node` is not known yet.
    """
    from dextera_build.engine.dry import plan
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
        outputs = f"; a later run gave another output, {again.again[-1][:12]} for {again.first[:12]}" if again else ""
        return f"up to date: key {(state.key or '')[:12]}, {since}{outputs}", []
    if state is not None and state.bare:
        maker = f", since {when}" if entry and entry.key == state.key else ""
        return f"bare: key {(state.key or '')[:12]}{maker}; {NO_BYTES}; the next build fetches or rebuilds them", []
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
