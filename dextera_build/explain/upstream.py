"""The nodes of a plan that an input comes from."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

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
    parse_address,
    parts_of,
)


class Upstream:
    """Direct dependencies in a graph.

    Args:
        graph: The resolved recipe.
        nodes: The addresses of a dry run; `body.mesh` means copies that are not known yet.
    """

    def __init__(self, graph: Graph, nodes: Iterable[str]) -> None:
        self._graph = graph
        self._copies: dict[tuple[str, ...], list[Address]] = {}
        for node in nodes:
            address = parse_address(node)
            self._copies.setdefault(address.call, []).append(address)

    def call(self, node: str) -> Call:
        """The call that a node is a copy of."""
        address = parse_address(node)
        return self._graph.copy(address.call, address.labels or ())

    def read_by(self, node: str) -> dict[str, list[str]]:
        """Slot -> the nodes that this input comes from; nodes that open the group of a collection come first."""
        return {slot: self.nodes(node, source) for slot, source in self.call(node).inputs.items()}

    def all_read_by(self, node: str) -> list[str]:
        """The nodes that any input comes from."""
        return list(dict.fromkeys(source for sources in self.read_by(node).values() for source in sources))

    def nodes(self, node: str, source: Input) -> list[str]:
        """The nodes that one input of `node` comes from."""
        reader = parse_address(node)
        return list(dict.fromkeys(found for part in parts_of(source) for found in self._of_part(reader, part)))

    def openers(self, node: str) -> list[str]:
        """The nodes whose outputs open the groups around `node`."""
        reader = parse_address(node)
        return list(dict.fromkeys(self._opening(reader, reader.call, 1)))

    def _of_part(self, reader: Address, part: Leaf | Output | Item | Gather | Fixed) -> Iterator[str]:
        while isinstance(part, Item):
            part = self._graph.group(part.group).over
        if isinstance(part, Leaf | Fixed):
            return
        labels, shared = reader.labels or (), _shared(reader.call, part.call)
        yield from self._opening(reader, part.call, shared + 1)
        for address in self._copies.get(part.call, ()):
            mine = (address.labels or ())[:shared]
            if mine == labels[: len(mine)]:
                yield str(address)

    def _opening(self, reader: Address, call: tuple[str, ...], first: int) -> Iterator[str]:
        for depth in range(first, len(call)):
            yield from self._of_part(reader, self._graph.group(call[:depth]).over)


def _shared(reader: tuple[str, ...], source: tuple[str, ...]) -> int:
    """Number of groups that enclose both calls."""
    depth = min(len(reader), len(source)) - 1
    return next((level for level in range(depth) if reader[level] != source[level]), depth)
