"""Refuses graphs with cycles."""

from __future__ import annotations

from graphlib import CycleError, TopologicalSorter

from dextera_build.engine.graph import Graph
from dextera_build.errors import RecipeError


def refuse(graph: Graph) -> None:
    """Check the static graph for cycles.

    Raises:
        RecipeError: There is a cycle; the message lists its nodes in order.
    """
    calls = dict(graph.calls())
    try:
        TopologicalSorter({address: list(graph.needs(address)) for address in calls}).prepare()
    except CycleError as error:
        loop = error.args[1][::-1]
        raise RecipeError(
            "the recipe feeds into itself",
            code="DXB-R108",
            where=calls[loop[0]].where,
            facts={"cycle": " -> ".join("`" + ".".join(part) + "`" for part in loop)},
        ) from None
