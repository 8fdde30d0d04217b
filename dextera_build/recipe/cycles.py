"""Refuses graphs that feed into themselves."""

from __future__ import annotations

from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter

from dextera_build.engine.graph import Call, Fixed, Gather, Graph, Input, Item, Output, parts_of
from dextera_build.engine.lookup import group_at
from dextera_build.errors import RecipeError

Address = tuple[str, ...]


def refuse(graph: Graph) -> None:
    """Walk the static graph once.

    Raises:
        RecipeError: There is a cycle; the message shows it from node to node.
    """
    calls = dict(graph.calls())
    try:
        TopologicalSorter({address: list(_needs(address, call, graph)) for address, call in calls.items()}).prepare()
    except CycleError as error:
        loop = error.args[1][::-1]
        raise RecipeError(
            "the recipe feeds into itself",
            code="DXB-R108",
            where=calls[loop[0]].where,
            facts={"cycle": " -> ".join("`" + ".".join(part) + "`" for part in loop)},
        ) from None


def _needs(address: Address, call: Call, graph: Graph) -> Iterator[Address]:
    inputs: list[Input] = [part for source in call.inputs.values() for part in parts_of(source)]
    # A copy exists only once its group's collection is known.
    opened = [group_at(graph, address[:depth]).over for depth in range(1, len(address))]
    inputs += [over for over in opened if not isinstance(over, Fixed)]
    for given in inputs:
        if isinstance(given, Output | Gather):
            yield given.call
        elif isinstance(given, Item):
            over = group_at(graph, given.group).over
            if isinstance(over, Output):
                yield over.call
