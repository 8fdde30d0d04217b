"""Refuses graphs that feed into themselves."""

from __future__ import annotations

from graphlib import CycleError, TopologicalSorter

from dextera_build.engine.graph import Graph
from dextera_build.errors import RecipeError


def refuse(graph: Graph) -> None:
    """Walk the static graph once.

    Raises:
        RecipeError: There is a cycle; the message shows it from node to node.
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
