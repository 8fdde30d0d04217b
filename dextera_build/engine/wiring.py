"""From the plan to units: only what the targets need, each once, connected to what it reads."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path as FilePath

from dextera_build.engine.graph import (
    Address,
    Fixed,
    Gather,
    Graph,
    Input,
    Item,
    Leaf,
    Output,
    Pack,
    node_address,
)
from dextera_build.engine.known import Known
from dextera_build.engine.reach import group_at, leaves_of
from dextera_build.engine.states import State
from dextera_build.engine.units import Gathering, Labels, Link, Node, Opening, Packing, Path, Unit
from dextera_build.errors import DxbError, UsageError, did_you_mean, listing


class Wiring:
    """The units of one run.

    Args:
        graph: The plan.
        digest_leaf: Puts a file or folder into the store and returns its artifact's digest.
        known: What the last build found; units that it knows are done at once.
    """

    def __init__(self, graph: Graph, digest_leaf: Callable[[FilePath], str], known: Known | None = None) -> None:
        self.graph = graph
        self.known = known
        self.nodes: dict[tuple[Path, Labels], Node] = {}
        self.openings: dict[tuple[Path, Labels], Opening] = {}
        self.fresh: deque[Unit] = deque()
        """Units that are not connected yet."""
        self._gatherings: dict[tuple[Path, Labels, tuple[str, ...]], Gathering] = {}
        self.leaves: dict[FilePath, str] = {}
        """Files and folders that were looked at -> digest."""
        self._digest_leaf = digest_leaf

    def wish(self, target: Address) -> Gathering:
        """Ask for all copies of a call that `target` names."""
        unit = Gathering(address=str(target), path=target.call, labels=target.labels or (), collect=False)
        self.fresh.append(unit)
        return unit

    def node(self, path: Path, labels: Labels) -> Node:
        """The copy of a call with these labels."""
        unit = self.nodes.get((path, labels))
        if unit is None:
            unit = Node(address=node_address(path, labels), path=path, labels=labels, graph=self.graph)
            self.nodes[path, labels] = unit
            self._welcome(unit)
        return unit

    def opening(self, path: Path, labels: Labels) -> Opening:
        """The group at `path` within the copies with these labels."""
        unit = self.openings.get((path, labels))
        if unit is None:
            group = group_at(self.graph, path)
            unit = Opening(address=node_address(path, labels), path=path, labels=labels, group=group)
            self.openings[path, labels] = unit
            self._welcome(unit)
        return unit

    def gatherings(self) -> Iterable[Gathering]:
        """All collections of copies; what targets ask for is not among them."""
        return self._gatherings.values()

    def count(self) -> int:
        """How many nodes there are, as far as is known."""
        return len(self.nodes) + (self.known.kept - self.known.stubs if self.known else 0)

    def leaf(self, leaf: Leaf) -> str:
        """Digest of a file or folder; one look a run.

        Raises:
            RecipeError: It is missing or cannot be read.
        """
        if leaf.path not in self.leaves:
            try:
                self.leaves[leaf.path] = self._digest_leaf(leaf.path)
            except DxbError as error:
                error.where = error.where or leaf.where
                raise
        return self.leaves[leaf.path]

    def forget_leaves(self, node: Node) -> None:
        """Look anew at the files and folders of `node` when it is connected again."""
        for leaf, _ in node.leaves:
            self.leaves.pop(leaf.path, None)

    def connect(self, unit: Unit) -> None:
        """Find what `unit` reads and wait for what is not known.

        Raises:
            DxbError: A leaf cannot be read, or a label does not exist.
        """
        if isinstance(unit, Node):
            call = unit.call
            leaves = [(source, self.leaf(source)) for source in leaves_of((call,))]
            if leaves:
                unit.leaves = leaves
            self._await_all(unit, call.inputs)
        elif isinstance(unit, Packing):
            self._await_all(unit, unit.parts)
        elif isinstance(unit, Opening) and not isinstance(unit.group.over, Fixed):
            unit.over = self._link(unit.group.over, unit)
            if unit.over.unit is not None:
                unit.await_(unit.over.unit)
        elif isinstance(unit, Gathering):
            unit.nodes = {}
            self._spread(unit, [()])

    def _await_all(self, unit: Node | Packing, sources: Mapping[str, Input]) -> None:
        unit.links = {name: self._link(source, unit) for name, source in sources.items()}
        for source in dict.fromkeys(link.unit for link in unit.links.values() if link.unit is not None):
            unit.await_(source)

    def expand(self, unit: Gathering, opened: Opening) -> None:
        """Go on from a group that `unit` waited for and that is open now.

        Raises:
            UsageError: A target names a copy that the group does not have.
        """
        self._spread(unit, [(*opened.labels, label) for label in reversed(_chosen(unit, opened))])

    def _spread(self, unit: Gathering, frontier: list[Labels]) -> None:
        depth = len(unit.path) - 1
        while frontier:
            labels = frontier.pop()
            if len(labels) == depth:
                unit.nodes[labels] = self.node(unit.path, labels)
                unit.nodes[labels].asked |= not unit.collect
                unit.await_(unit.nodes[labels])
                continue
            opening = self.opening(unit.path[: len(labels) + 1], labels)
            unit.await_(opening)
            if opening.state is State.DONE:
                frontier += [(*labels, label) for label in reversed(_chosen(unit, opening))]

    def _link(self, source: Input, reader: Unit) -> Link:
        scope = reader.path[:-1]
        if isinstance(source, Leaf):
            return Link(digest=self.leaf(source))
        if isinstance(source, Item):
            level = len(source.group)
            opening = self.opening(source.group, reader.labels[: level - 1])
            return Link(opening, source.fields, label=reader.labels[level - 1])
        if isinstance(source, Output):
            level = len(source.call) - 1
            assert source.call[:-1] == scope[:level], f"{reader.address} reads into a group: {source.call}"
            return Link(self.node(source.call, reader.labels[:level]), source.fields)
        if isinstance(source, Pack):
            pack = Packing(address=reader.address, path=reader.path, labels=reader.labels, parts=source.parts)
            self.fresh.append(pack)
            return Link(pack)
        return Link(self._gathering(source, scope, reader.labels))

    def _gathering(self, source: Gather, scope: Path, labels: Labels) -> Gathering:
        shared = 0
        for mine, other in zip(scope, source.call[:-1], strict=False):
            if mine != other:
                break
            shared += 1
        place = (source.call, labels[:shared], source.fields)
        unit = self._gatherings.get(place)
        if unit is None:
            address = str(Address(source.call, labels[:shared] or None))
            unit = Gathering(
                address=address, path=source.call, labels=labels[:shared], collect=True, fields=source.fields
            )
            self._gatherings[place] = unit
            self._welcome(unit)
        return unit

    def _welcome(self, unit: Unit) -> None:
        if self.known is None or not self.known.settle(unit):
            self.fresh.append(unit)
        elif not isinstance(unit, Node):
            self.connect(unit)  # events say which nodes stand behind it


def _chosen(unit: Gathering, opened: Opening) -> list[str]:
    """Labels of `opened` that `unit` wants."""
    level = len(opened.labels)
    if level >= len(unit.labels):
        return list(opened.items)
    wanted = unit.labels[level]
    if wanted not in opened.items:
        raise UsageError(
            f"`{unit.address}`: there is no `{wanted}` in `{opened.address}`",
            code="DXB-U203",
            facts={"copies": listing(opened.items)},
            hint=did_you_mean(wanted, opened.items),
        )
    return [wanted]
