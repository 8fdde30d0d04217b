"""Refuses graphs that feed into themselves."""

from __future__ import annotations

from collections.abc import Iterator

from dextera_build.engine.graph import Call, Fixed, Gather, Graph, Input, Item, Leaf, Output, parts_of
from dextera_build.engine.lookup import copy_of, group_at
from dextera_build.errors import RecipeError

Address = tuple[str, ...]


def refuse(graph: Graph) -> None:
    """Walk the static graph once.

    Raises:
        RecipeError: There is a cycle; the message shows it from node to node.
    """
    _Walk(graph).run()


class Order:
    """Whether every call so far reads only what stood before it, as in most recipes: then there is no cycle.

    A group makes an end of that; so `holds` is a yes, and else nothing is known.
    """

    def __init__(self) -> None:
        self.holds = True
        self._before: set[str] = set()

    def note(self, address: Address, call: Call) -> None:
        """Take note of one more call."""
        if self.holds:
            read = (part for source in call.inputs.values() for part in parts_of(source) if not isinstance(part, Leaf))
            self.holds = len(address) == 1 and all(
                isinstance(part, Output) and len(part.call) == 1 and part.call[0] in self._before for part in read
            )
            self._before.add(address[0])


class _Walk:
    """From every call to what it reads, depth first."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._stack: list[tuple[Address, Iterator[Address]]] = []
        self._trail: dict[Address, None] = {}

    def run(self) -> None:
        """Come to every call once."""
        done: set[Address] = set()
        for start, _ in self._graph.calls():
            if start not in done:
                self._push(start)
            while self._stack:
                address, needs = self._stack[-1]
                following = next((need for need in needs if need not in done), None)
                if following is None:
                    self._stack.pop()
                    self._trail.popitem()
                    done.add(address)
                elif following in self._trail:
                    raise self._cycle(following)
                else:
                    self._push(following)

    def _push(self, address: Address) -> None:
        self._stack.append((address, _needs(address, copy_of(self._graph, address, ()), self._graph)))
        self._trail[address] = None

    def _cycle(self, following: Address) -> RecipeError:
        way = list(self._trail)
        loop = [*way[way.index(following) :], following]
        names = " -> ".join("`" + ".".join(part) + "`" for part in loop)
        return RecipeError(
            "the recipe feeds into itself",
            code="DXB-R108",
            where=copy_of(self._graph, following, ()).where,
            facts={"cycle": names},
        )


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
