"""Which nodes an input comes from, by the names that a dry run gave them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import takewhile
from typing import TYPE_CHECKING

from dextera_build.engine.graph import (
    Address,
    Call,
    Fixed,
    Gather,
    Graph,
    Input,
    Item,
    Leaf,
    Output,
    Pack,
    node_address,
    parse_address,
    parts_of,
)
from dextera_build.engine.lookup import copy_of, group_at

if TYPE_CHECKING:
    from dextera_build.engine.dry import Planned
    from dextera_build.project.project import Project


class Upstream:
    """One step up in a graph.

    Args:
        project: For paths as messages show them.
        graph: The recipe, resolved.
        states: What a dry run found, by address; `body.mesh` stands for copies that are not known.
    """

    def __init__(self, project: Project, graph: Graph, states: Mapping[str, Planned]) -> None:
        self._project, self._graph, self._states = project, graph, states

    def call(self, node: str) -> Call:
        """The call that a node is a copy of."""
        address = parse_address(node)
        return copy_of(self._graph, address.call, address.labels or ())

    def groups(self, node: str) -> dict[str, Input]:
        """Enclosing group, by its name -> the collection that it opens over."""
        path = parse_address(node).call
        found = {path[depth - 1]: group_at(self._graph, path[:depth]).over for depth in range(1, len(path))}
        return {group: over for group, over in found.items() if not isinstance(over, Fixed)}

    def nodes(self, node: str, source: Input) -> list[str]:
        """The nodes that an input of `node` comes from."""
        found = [address for part in parts_of(source) for address in self._of_part(parse_address(node), part)]
        return list(dict.fromkeys(found))

    def openers(self, node: str, source: Input) -> list[str]:
        """The nodes whose outputs say which copies a gathered input of `node` has."""
        found: list[str] = []
        for part in parts_of(source):
            if isinstance(part, Gather):
                shared = _shared(parse_address(node), part)
                for depth in range(shared + 1, len(part.call)):
                    over = group_at(self._graph, part.call[:depth]).over
                    found += self.nodes(node, over) if not isinstance(over, Fixed) else []
        return list(dict.fromkeys(found))

    def shown(self, source: Input | None, call: Call) -> str:
        """The file, or the call, that an input comes from."""
        while isinstance(source, Item):
            source = self._opened_over(source)
        if isinstance(source, Leaf):
            return self._project.shown(source.path)
        if isinstance(source, Output | Gather):
            return ".".join((*source.call, *source.fields))
        if isinstance(source, Pack):
            return ", ".join(self.shown(part, call) for part in source.parts.values())
        return str(call.where)

    def _of_part(self, reader: Address, part: Input) -> Iterator[str]:
        labels = reader.labels or ()
        while isinstance(part, Item):
            part = self._opened_over(part)
        if isinstance(part, Output):
            yield self._copy(part.call, labels)
        elif isinstance(part, Gather):
            shared = _shared(reader, part)
            for address in self._states:
                at = parse_address(address)
                mine = (at.labels or ())[:shared]
                if at.call == part.call and mine == labels[: len(mine)]:
                    yield address

    def _opened_over(self, item: Item) -> Output | Item:
        over = group_at(self._graph, item.group).over
        assert not isinstance(over, Fixed), "a matrix has no items"
        return over

    def _copy(self, call: tuple[str, ...], labels: tuple[str, ...]) -> str:
        depth = len(call) - 1
        exact = node_address(call, labels[:depth]) if len(labels) >= depth else ""
        return exact if exact in self._states else ".".join(call)


def _shared(reader: Address, part: Gather) -> int:
    """How many groups enclose both the reader and what it gathers."""
    pairs = zip(reader.call[:-1], part.call[:-1], strict=False)
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))
