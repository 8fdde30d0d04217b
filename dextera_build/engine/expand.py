"""Turns the plan into units: only those the targets need, each once, connected to their sources."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

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
    no_copy,
    node_address,
    parts_of,
)
from dextera_build.engine.states import LOST, State
from dextera_build.engine.units import Gathering, Labels, Node, Opening, Path, Unit
from dextera_build.errors import DxbError, Place, RuleError
from dextera_build.store import headers
from dextera_build.store.store import Store

_LABEL = re.compile(r"[^\[\]/\\\x00-\x1f]+")


@dataclass(frozen=True)
class Unmatched:
    """A label under `overrides:` that no copy of its opened groups has."""

    group: Address
    label: str
    known: tuple[str, ...]
    """The labels of all copies."""
    where: Place
    """Of the group in the recipe."""


class Wiring:
    """The units of one run.

    Args:
        graph: The plan.
        store: Stores files and folders, and holds the headers of outputs.
    """

    def __init__(self, graph: Graph, store: Store) -> None:
        self.graph = graph
        self.nodes: dict[str, Node] = {}
        """By address."""
        self.openings: dict[tuple[Path, Labels], Opening] = {}
        self.fresh: deque[Unit] = deque()
        """Units that are not connected yet."""
        self._gatherings: dict[tuple[Path, Labels, tuple[str, ...]], Gathering] = {}
        self.leaves: dict[str, str] = {}
        """Digests of files and folders by path; strings take a quarter of the memory of `Path` objects."""
        self.wishes: list[Gathering] = []
        """The targets."""
        self._store = store

    def ask(self, targets: Iterable[Address]) -> None:
        """Request all copies of the calls that targets name."""
        for target in targets:
            unit = Gathering(address=str(target), path=target.call, labels=target.labels or (), collect=False)
            self.wishes.append(unit)
            self.fresh.append(unit)

    @property
    def asked(self) -> Iterator[str]:
        """Addresses of the nodes that targets name, in the groups opened so far."""
        return (node.address for wish in self.wishes for node in wish.nodes.values())

    def node(self, path: Path, labels: Labels) -> Node:
        """The copy of a call with these labels."""
        address = node_address(path, labels) if labels else path[0]
        unit = self.nodes.get(address)
        if unit is None:
            unit = self.nodes[address] = Node(
                address=address, path=path, labels=labels, call=self.graph.copy(path, labels)
            )
            self.fresh.append(unit)
        return unit

    def opening(self, path: Path, labels: Labels) -> Opening:
        """The group at `path` within the copies with these labels."""
        unit = self.openings.get((path, labels))
        if unit is None:
            group = self.graph.group(path)
            unit = Opening(address=node_address(path, labels), path=path, labels=labels, group=group)
            self.openings[path, labels] = unit
            self.fresh.append(unit)
        return unit

    def leaf(self, leaf: Leaf) -> str:
        """Digest of a file or folder, computed once per run.

        Raises:
            RecipeError: It is missing or cannot be read.
        """
        path = str(leaf.path)
        if path not in self.leaves:
            try:
                self.leaves[path] = self._store.leaves.digest_leaf(leaf.path)
            except DxbError as error:
                error.where = error.where or leaf.where
                raise
        return self.leaves[path]

    def look(self, targets: Sequence[Address]) -> list[Path]:
        """Digest every file and folder that targets may need; returns the addresses of all calls they may need.

        Raises:
            UsageError: A target names a copy that its group does not have.
            RecipeError: A file or folder is missing or cannot be read.
        """
        paths = list(self.graph.walk(targets))
        for path in paths:
            for call in self.graph.variants(path):
                for leaf in call.leaves():
                    self.leaf(leaf)
        return paths

    def forget_leaves(self, node: Node) -> None:
        """Digest the files and folders of `node` again when it is reconnected."""
        for leaf in node.call.leaves():
            self.leaves.pop(str(leaf.path), None)

    def note_leaves(self, node: Node, call: Call) -> None:
        """Record the files and folders that `node`, a copy of `call`, reads, with their current digests.

        Raises:
            RecipeError: One of them cannot be read.
        """
        node.leaves = [(leaf, self.leaf(leaf)) for leaf in call.leaves()]

    def connect(self, unit: Unit) -> None:
        """Find the sources of `unit` and wait for the unknown ones; new units are connected next.

        Raises:
            DxbError: A leaf cannot be read, or a label does not exist.
        """
        known = len(self.fresh)
        self._connect(unit)
        for _ in range(len(self.fresh) - known):  # depth first, so that the first runnable nodes turn up early
            self.fresh.appendleft(self.fresh.pop())

    def _connect(self, unit: Unit) -> None:
        if isinstance(unit, Node):
            call = unit.call
            self.note_leaves(unit, call)
            sources = (self.sources(source, unit) for source in call.inputs.values())
            unit.await_(dict.fromkeys(chain.from_iterable(sources)))
        elif isinstance(unit, Opening) and not isinstance(unit.group.over, Fixed):
            unit.await_(self.sources(unit.group.over, unit))
        elif isinstance(unit, Gathering):
            unit.nodes = {}
            self._spread(unit, [()])

    def sources(self, source: Input, reader: Unit) -> Iterator[Unit]:
        """The source units of an input of `reader`; none for a file or folder."""
        for part in parts_of(source):
            unit = self.source(part, reader)
            if unit is not None:
                yield unit

    def source(self, part: Leaf | Output | Item | Gather, reader: Unit) -> Unit | None:
        """The source unit of one part of an input of `reader`, or None for a file or folder."""
        if isinstance(part, Output):
            level = len(part.call) - 1
            assert not level or part.call[:-1] == reader.path[:-1][:level], f"{reader} reads into a group: {part.call}"
            return self.node(part.call, reader.labels[:level])
        if isinstance(part, Leaf):
            return None
        if isinstance(part, Item):
            return self.opening(part.group, reader.labels[: len(part.group) - 1])
        return self._gathering(part, reader.path[:-1], reader.labels)

    def values(self, node: Node) -> dict[str, str]:
        """Slot -> digest of the inputs of `node`, whose sources are known; without optional fields that are not set.

        Raises:
            DxbError: See `value`.
        """
        found: dict[str, str] = {}
        for slot, source in node.call.inputs.items():
            if isinstance(source, Output | Item) and source.optional:
                start = self.value(replace(source, fields=()), node)
                given = headers.project_set(self._store.blobs.get, start, source.fields)
                if given is not None:
                    found[slot] = given
            else:
                found[slot] = self.value(source, node)
        return found

    def value(self, source: Input, reader: Unit) -> str:
        """Digest of an input of `reader` whose sources are known; stores a collection that the recipe lists.

        Raises:
            DxbError: A field does not exist, a file cannot be read, or the collection cannot be stored.
        """
        blobs = self._store.blobs
        if isinstance(source, Pack):
            there = {label: part for label, part in source.parts.items() if self._is_there(part, reader)}
            parts = {label: self.value(part, reader) for label, part in there.items()}
            return blobs.put(headers.collection_header(parts))
        if isinstance(source, Leaf):
            return self.leaf(source)
        unit = self.source(source, reader)
        start: str | None = None
        if isinstance(unit, Node | Gathering):
            start = unit.output
        elif isinstance(unit, Opening):
            start = unit.items[reader.labels[len(unit.labels)]]
        assert start is not None, f"{reader.address} is not ready"
        # A gathering has already followed the fields.
        fields = () if isinstance(source, Gather) else source.fields
        return headers.project(blobs.get, start, fields) if fields else start

    def _is_there(self, part: Leaf | Output | Item | Gather, reader: Unit) -> bool:
        """Whether an entry of a listed collection was not left out."""
        unit = self.source(part, reader)
        return unit is None or unit.state not in LOST

    def items(self, unit: Opening) -> dict[str, str]:
        """Label -> digest of each item in the known collection of a group.

        Raises:
            DxbError: It is not a collection, or a label is not allowed, or the request names a copy that is not there.
        """
        if isinstance(unit.group.over, Fixed):
            found = dict.fromkeys(unit.group.over.labels, "")
        else:
            found = headers.items(self._store.blobs.get, self.value(unit.group.over, unit))
        for label in found:
            if not _LABEL.fullmatch(label):
                raise RuleError(
                    f"group `{unit.address}` cannot be opened: `{label}` is not a label",
                    code="DXB-B306",
                    facts={"labels": "one character or more, none of them [ ] / \\ or a control character"},
                )
        self._refuse_unnamed(unit, found)
        return found

    def _refuse_unnamed(self, unit: Opening, items: Iterable[str]) -> None:
        """Refuse a request that names a copy which no opening of the group holds; the last one to open tells."""
        known = set(items)
        others = [other for (path, _), other in self.openings.items() if path == unit.path and other is not unit]
        for label, text in unit.group.named.items():
            if label not in known and all(o.state is State.DONE and label not in o.items for o in others):
                raise no_copy(text, unit.address, label, known)

    def unmatched(self) -> Iterator[Unmatched]:
        """Labels under `overrides:` of opened groups that no copy has: a misspelt one changes nothing."""
        opened: dict[Path, list[Opening]] = {}
        for (path, _), unit in self.openings.items():
            opened.setdefault(path, []).append(unit)
        for path, units in opened.items():
            if all(unit.state is State.DONE for unit in units):
                group, known = units[0].group, {label for unit in units for label in unit.items}
                for label in sorted(set(group.overrides) - known):
                    yield Unmatched(Address(path), label, tuple(sorted(known)), group.where)

    def collection(self, unit: Gathering) -> str:
        """Store the collection of the known outputs of all copies; returns its digest.

        Raises:
            DxbError: Two copies share a label, a field does not exist, or the collection cannot be stored.
        """
        parts: dict[str, str] = {}
        for labels, node in sorted(unit.nodes.items()):
            assert node.output is not None
            label = ".".join(labels[len(unit.labels) :])
            if label in parts:
                raise RuleError(f"`{unit.address}` has two copies called `{label}`", code="DXB-B307")
            parts[label] = headers.project(self._store.blobs.get, node.output, unit.fields)
        return self._store.blobs.put(headers.collection_header(parts))

    def expand(self, unit: Gathering, opened: Opening) -> None:
        """Continue `unit` from a group that it waited for and that is now open.

        Raises:
            UsageError: A target names a copy that the group does not have.
        """
        self._spread(unit, [(*opened.labels, label) for label in reversed(_chosen(unit, opened))])

    def _spread(self, unit: Gathering, frontier: list[Labels]) -> None:
        depth = len(unit.path) - 1
        found: list[Unit] = []
        while frontier:
            labels = frontier.pop()
            if len(labels) == depth:
                node = unit.nodes[labels] = self.node(unit.path, labels)
                node.asked |= not unit.collect
                found.append(node)
                continue
            opening = self.opening(unit.path[: len(labels) + 1], labels)
            found.append(opening)
            if opening.state is State.DONE:
                frontier += [(*labels, label) for label in reversed(_chosen(unit, opening))]
        unit.await_(found)

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
            self.fresh.append(unit)
        return unit


def _chosen(unit: Gathering, opened: Opening) -> list[str]:
    """Labels of `opened` that `unit` needs."""
    level = len(opened.labels)
    if level >= len(unit.labels):
        return list(opened.items)
    wanted = unit.labels[level]
    if wanted not in opened.items:
        raise no_copy(unit.address, opened.address, wanted, opened.items)
    return [wanted]
