"""`dxb plan --check` and `dxb build --check`: stale nodes with their causes, one line each; nothing runs."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from dextera_build.cli import table
from dextera_build.engine.dry import plan as dry
from dextera_build.errors import StaleError
from dextera_build.explain.causes import Causes
from dextera_build.report.wording import count
from dextera_build.session import NO_BYTES

if TYPE_CHECKING:
    from dextera_build.engine.dry import Planned
    from dextera_build.engine.graph import Address, Graph
    from dextera_build.session import Session


def check(
    document: str,
    session: Session,
    graph: Graph,
    wanted: Sequence[Address],
    *,
    as_json: bool = False,
    refuses: bool = True,
) -> int:
    """Print every stale node with its cause; then, with `refuses`, raise if there is one, otherwise count them.

    Args:
        document: Name of the document with `as_json`.
        session: The recipe.
        graph: Its graph.
        wanted: The targets.
        as_json: Whether to print JSON.
        refuses: Whether to raise.

    Raises:
        StaleError: A node that `wanted` needs would run.
    """
    states = {node.address: node for node in dry(graph, wanted, session.store, history=session.past_builds)}
    stale = [name for name, node in states.items() if node.status == "stale"]
    waiting = sum(node.status == "unknown" for node in states.values())
    causes = Causes(session, graph, states)
    rows = [{"node": name, "why": _reason(session, states, causes, name)} for name in stale]
    table.give(document, rows, as_json=as_json)
    if stale and refuses:
        raise StaleError(
            f"`{session.recipe}` is stale",
            code="DXB-C102",
            facts={"stale": count(len(stale), "node"), "may follow": count(waiting, "node")},
            hint=f"`dxb why '{session.recipe}:{stale[0]}'`",
        )
    told = f"{count(len(stale), 'node')} of {session.recipe} would run" if stale else f"{session.recipe} is up to date"
    print(f"{told}, {waiting} may follow" if waiting else told, file=sys.stderr)
    return 0


def _reason(session: Session, states: Mapping[str, Planned], causes: Causes, node: str) -> str:
    """Why a node is stale, in one line: the first change, and the number of further ones."""
    entry = session.past_builds.get(node)
    if states[node].bare:
        return f"its result is bare: {NO_BYTES}"
    if entry is None:
        return "never built"
    if entry.key == states[node].key:
        return "built, but the store no longer holds it"
    first, *more = causes.direct(node)
    name = "" if first.name == first.kind else first.name
    told = " ".join(cell for cell in (first.kind, name, first.change, first.place) if cell)
    return f"{told}, and {len(more)} more" if more else told
