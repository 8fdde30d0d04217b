"""Why a node is stale, or when it was built: one sentence, and the causes."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from dextera_build.errors import UsageError
from dextera_build.report.wording import count
from dextera_build.session import NO_BYTES, addresses

if TYPE_CHECKING:
    from dextera_build.explain.causes import Cause
    from dextera_build.session import Session


def explain(session: Session, node: str) -> tuple[str, list[Cause]]:
    """A sentence about a node, and the causes of its staleness.

    Raises:
        UsageError: `node` is not known yet.
    """
    from dextera_build.engine.dry import plan
    from dextera_build.explain.causes import Causes

    graph, entry = session.plan().graph, session.past_builds.get(node)
    found = plan(graph, addresses(graph, node), session.store, history=session.past_builds)
    states = {planned.address: planned for planned in found}
    state = states.get(node)
    if state is None and entry is None:
        raise UsageError(
            f"`{session.recipe}:{node}` does not exist yet: the collection of its group is not built",
            code="DXB-U114",
            facts={"stale": ", ".join(name for name, planned in states.items() if planned.status == "stale")},
            hint=f"`dxb build '{session.recipe}:{node}'`",
        )
    when = f"run {entry.run} ({_ago(entry.time)})" if entry else ""
    if state is not None and (state.status == "cached" or state.bare):
        # The run in which the node got this key: it ran, was fetched, or was in the store already.
        since = f"since {when}" if entry and entry.key == state.key else "built by an earlier run or another recipe"
        key = (state.key or "")[:12]
        if state.status != "cached":
            return f"bare: key {key}, {since}; {NO_BYTES}; the next build fetches or rebuilds them", []
        again = session.store.divergent.get(state.key or "")
        outputs = f"; a later run gave another output, {again.again[-1][:12]} for {again.first[:12]}" if again else ""
        return f"up to date: key {key}, {since}{outputs}", []
    causes = Causes(session, graph, states).of(node)
    if entry is None:
        return "never built", causes
    if state is None or not state.key_document:
        return f"may be stale, depending on its inputs; it was up to date in {when}", causes
    if state.key == entry.key:
        return f"up to date in {when}, but the store no longer holds it", []
    things = count(sum(cause.depth == 0 for cause in causes), "thing it depends on", "things it depends on")
    return f"stale: {things} changed since {when}", causes


def _ago(when: float) -> str:
    seconds = time.time() - when
    for size, name in ((86400, "day"), (3600, "hour"), (60, "minute")):
        if seconds >= size:
            return f"{count(int(seconds // size), name)} ago"
    return "a moment ago"
