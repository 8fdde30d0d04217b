"""What the last build of a request found, so that the next one looks only at what stands above changed files.

    <name>.plan     the graph (see `compact`), who reads whom, which nodes read which file or folder
    <name>.known    key, output and seconds of every node; items of groups; outputs of collections

The full build remains the reference: whatever is known here it would find again.
"""

from __future__ import annotations

import json
from array import array
from bisect import bisect_left
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dextera_build.engine import compact
from dextera_build.engine.compact import Members, Names, Texts
from dextera_build.engine.graph import Graph, RuleFacts, parse_address
from dextera_build.engine.reach import copy_of, leaves_of
from dextera_build.engine.reread import Reread
from dextera_build.engine.states import State
from dextera_build.engine.units import Gathering, Node, Opening, Unit
from dextera_build.store import frames

if TYPE_CHECKING:
    from dextera_build.engine.wiring import Wiring


_KEPT = "kept"


@dataclass
class Known:
    """A graph, and what each of its units came to."""

    head: dict[str, Any]
    graph: Graph
    rules: list[RuleFacts]
    """All that its calls name."""
    names: Names
    """Of nodes."""
    readers: array[int]
    """Node -> first of its readers in `read_by`; one more at the end."""
    read_by: array[int]
    keys: bytearray
    outputs: bytearray
    seconds: array[float]
    peaks: array[float]
    """Memory that each took the last time that it ran [GiB], 0 where that is not known."""
    items: dict[str, dict[str, str]]
    """Group -> label -> digest."""
    collections: dict[str, str]
    """Collection -> digest."""
    text: Callable[[], str]
    """Addresses of nodes, a line each."""
    leaves: dict[str, str]
    """File or folder that nodes read -> digest."""
    reread: Reread
    """What nodes read by themselves."""
    run: str
    """The run whose events say what there is to say of each node."""
    cone: set[int] = field(default_factory=set)
    """Nodes that stand above something that changed."""
    late: set[str] = field(default_factory=set)
    """Collections that do."""
    bare: set[int] = field(default_factory=set)
    """Nodes whose results are bare."""
    stubs: int = 0
    depth: int = 0
    """How many builds have gone on from the one that looked at everything."""

    @cached_property
    def in_question(self) -> frozenset[str]:
        """Nodes that are to be looked at, or whose bytes may be absent."""
        numbers = self.cone | self.bare
        addresses = self.addresses() if numbers else []
        return frozenset(addresses[number] for number in numbers)

    @property
    def kept(self) -> int:
        """How many nodes are known without a look."""
        return len(self.seconds) - len(self.cone)

    def spread(self, changed: Iterable[str], also: Iterable[int] = ()) -> bool:
        """Note all that stands above these files, folders and nodes; False where a group does, which may open anew."""
        units = [*also]
        for path in changed:
            units += self.head["leaves"][path]
        nodes = len(self.seconds)
        seen: set[int] = set()
        while units:
            unit = units.pop()
            if unit not in seen:
                seen.add(unit)
                units += self.read_by[self.readers[unit] : self.readers[unit + 1]]
        others = [self.head["others"][unit - nodes] for unit in seen if unit >= nodes]
        if any(kind == "opening" for kind, _ in others):
            return False
        self.cone = {unit for unit in seen if unit < nodes}
        self.late = {name for _, name in others}
        return True

    def settle(self, unit: Unit) -> bool:
        """Make a new unit what it is known to be; False where that is not known."""
        if isinstance(unit, Node):
            return self._settle_node(unit)
        if isinstance(unit, Opening) and unit.address in self.items:
            unit.items = self.items[unit.address]
        elif isinstance(unit, Gathering) and _name(unit) in self.collections and _name(unit) not in self.late:
            unit.output = self.collections[_name(unit)]
        else:
            return False
        unit.state = State.DONE
        return True

    def key(self, address: str) -> str | None:
        """The key that a node had."""
        number = self.names.find(address)
        return self.keys[number * 32 : number * 32 + 32].hex() if number is not None else None

    def output(self, address: str) -> str | None:
        """The output that a node had."""
        number = self.names.find(address)
        return self.outputs[number * 32 : number * 32 + 32].hex() if number is not None else None

    def rule(self, address: str) -> RuleFacts:
        """The rule of a node."""
        where = parse_address(address)
        return copy_of(self.graph, where.call, where.labels or ()).rule

    def took(self, address: str) -> float | None:
        """How long a node ran [s]."""
        number = self.names.find(address)
        return self.seconds[number] if number is not None else None

    def peak_gb(self, address: str) -> float | None:
        """Memory that a node took [GiB]."""
        number = self.names.find(address)
        return (self.peaks[number] or None) if number is not None else None

    def addresses(self) -> list[str]:
        """Of all nodes, in the order of the run that was written down."""
        return self.text().split("\n")

    def learn(self, wiring: Wiring, run: str) -> None:
        """Take over what a build found."""
        self.run, self.depth = run, self.depth + 1
        self.leaves |= _absolute(wiring.leaves)
        for node in wiring.nodes.values():
            number = self.names.find(node.address)
            if number is not None and node.key and node.output and not is_stub(node):
                self.reread.learn(number, node.reads)
                (self.bare.add if node.bare else self.bare.discard)(number)
                self.keys[number * 32 : number * 32 + 32] = node.facts[:32]
                self.outputs[number * 32 : number * 32 + 32] = node.facts[32:64]
                self.seconds[number] = node.made_s
                self.peaks[number] = node.usage.get("memory_bytes", 0.0) / 2**30 or self.peaks[number]
        for unit in wiring.gatherings():
            if unit.output is not None:
                self.collections[_name(unit)] = unit.output

    def write_state(self, path: Path) -> None:
        """Write down what units came to.

        Raises:
            StoreError: The store cannot take it.
        """
        state = {
            "items": self.items,
            "collections": self.collections,
            "leaves": self.leaves,
            "reads": self.reread.plain(),
            "run": self.run,
            "depth": self.depth,
            "bare": sorted(self.bare),
        }
        _write_state(path, state, [self.keys, self.outputs, self.seconds, self.peaks])

    def _settle_node(self, unit: Node) -> bool:
        number = self.names.find(unit.address)
        if number is None or number in self.cone:
            return False
        place = slice(number * 32, number * 32 + 32)
        unit.know(self.keys[place], self.outputs[place], self.seconds[number])
        unit.status, unit.state, unit.bare = _KEPT, State.DONE, number in self.bare
        self.stubs += 1
        return True


def is_stub(node: Node) -> bool:
    """Whether a node was known and has not been looked at."""
    return node.status == _KEPT


def write(
    path: Path, graph: Graph, wiring: Wiring, run: str, peak_gb: Callable[[str], float | None] = lambda address: None
) -> bool:
    """Write down a build in which every unit is done; `peak_gb` says what memory a node took.

    Returns:
        False where it cannot be told from hashes which node is which.

    Raises:
        StoreError: The store cannot take it.
    """
    nodes = list(wiring.nodes.values())
    others: list[Unit] = [*wiring.openings.values(), *wiring.gatherings()]
    if any(unit.state is not State.DONE for unit in chain(nodes, others)):
        return False
    # One file after the other: what the first is made of is gone when the second is made.
    if not _write_plan(path, graph, nodes, others, {id(node) for node in wiring.readers}):
        return False
    keys, outputs = bytearray(), bytearray()
    for node in nodes:
        keys += node.facts[:32]
        outputs += node.facts[32:64]
    state = {
        "items": {unit.address: unit.items for unit in wiring.openings.values()},
        "collections": {_name(unit): unit.output or "" for unit in wiring.gatherings()},
        "leaves": _absolute(wiring.leaves),
        "reads": Reread.of(nodes).plain(),
        "run": run,
        "depth": 0,
        "bare": [number for number, node in enumerate(nodes) if node.bare],
    }
    seconds = array("d", (node.made_s for node in nodes))
    peaks = array("d", (peak_gb(node.address) or 0.0 for node in nodes))
    _write_state(path, state, [keys, outputs, seconds, peaks])
    return True


def _write_plan(
    path: Path, graph: Graph, nodes: Sequence[Node], others: Sequence[Unit], readers: Container[int]
) -> bool:
    names = Names.of(node.address for node in nodes)
    if not names.are_distinct:
        return False
    starts, read_by = _readers([*nodes, *others])
    members = compact.members_of(graph)
    head: dict[str, Any] = {
        "name": graph.name,
        "targets": graph.targets,
        "rules": [compact.facts_to_plain(rule) for rule in members.rules],
        "calls": sum(not node.labels for node in nodes) + len({node.path for node in nodes if node.labels}),
        "groups": len({node.path[:depth] for node in nodes for depth in range(1, len(node.path))}),
        "others": [["opening", u.address] if isinstance(u, Opening) else ["gathering", _name(u)] for u in others],
        "leaves": _leaves(nodes, readers),
    }
    found, texts = members.names, members.texts
    columns: list[array[int]] = [names.hashes, names.numbers, starts, read_by, found.hashes, found.numbers, texts.ends]
    lines = "\n".join(node.address for node in nodes).encode()
    framed: list[frames.Part] = [*map(frames.part, columns), lines]
    frames.write(f"{path}.plan", head, [*framed, texts.heap], len(framed))
    return True


def _write_state(path: Path, state: Mapping[str, Any], columns: Iterable[bytearray | array[Any]]) -> None:
    frames.write(f"{path}.known", state, [*map(frames.part, columns)])


def read(path: Path) -> Known:
    """What `write` wrote.

    Raises:
        OSError: There is nothing.
        ValueError: It was damaged, or another version wrote it.
    """
    head, parts, heap = frames.read(f"{path}.plan")
    state, columns, _ = frames.read(f"{path}.known")
    hashes, numbers, starts, read_by, member_hashes, member_numbers, ends = (
        frames.numbers(kind, part) for kind, part in zip("QIIIIIQ", parts[:7], strict=True)
    )
    rules = [compact.facts_of(rule) for rule in head["rules"]]
    members = Members(Names(member_hashes, member_numbers), Texts(heap, ends), rules)
    targets = {name: tuple(tuple(call) for call in calls) for name, calls in head["targets"].items()}
    return Known(
        head=head,
        graph=Graph(head["name"], members, targets),
        rules=rules,
        names=Names(hashes, numbers),
        readers=starts,
        read_by=read_by,
        keys=bytearray(columns[0]),
        outputs=bytearray(columns[1]),
        seconds=frames.numbers("d", columns[2]),
        peaks=frames.numbers("d", columns[3]),
        items=state["items"],
        collections=state["collections"],
        text=lambda: bytes(parts[7]).decode(),
        leaves=state["leaves"],
        reread=Reread.of_plain(state["reads"]),
        run=state["run"],
        depth=state["depth"],
        bare=set(state["bare"]),
    )


def _readers(units: Sequence[Unit]) -> tuple[array[int], array[int]]:
    """Where the readers of each unit begin, and all readers, by number."""
    numbers = Names.of_hashes(array("Q", map(id, units)))  # a dict would take ten times as much memory
    places, found = numbers.hashes, numbers.numbers
    read = array("I")
    starts = array("I", bytes(4 * (len(units) + 1)))
    for unit in units:
        for source in unit.sources:
            place = bisect_left(places, id(source))
            assert places[place] == id(source), f"{unit} reads {source}, which is no unit of the run"
            number = found[place]
            read.append(number)
            starts[number + 1] += 1
    for number in range(len(units)):
        starts[number + 1] += starts[number]
    read_by, ends = array("I", bytes(4 * starts[-1])), starts[:-1]
    one_by_one = iter(read)
    for number, unit in enumerate(units):
        for where in islice(one_by_one, len(unit.sources)):
            read_by[ends[where]] = number
            ends[where] += 1
    return starts, read_by


def _absolute(leaves: Mapping[str, str]) -> dict[str, str]:
    return {str(Path(path).absolute()): digest for path, digest in leaves.items()}


def _leaves(nodes: Sequence[Node], readers: Container[int]) -> dict[str, list[int]]:
    found: dict[str, list[int]] = {}
    for number, node in enumerate(nodes):
        for leaf in leaves_of((node.call,)) if id(node) in readers else ():
            found.setdefault(str(leaf.path.absolute()), []).append(number)
    return found


def _name(unit: Unit) -> str:
    assert isinstance(unit, Gathering)
    return json.dumps([unit.path, unit.labels, unit.fields])
