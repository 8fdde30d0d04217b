"""What a run is made of: nodes, groups that open, and collections that are gathered.

A build of a hundred thousand nodes has as many units at one time, so a unit has slots for what every unit has, and room
for the rest only while there is something in it.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, MutableMapping, Sequence
from typing import Any, Generic, TypeVar

from dextera_build.engine.graph import Call, Graph, Group, Leaf, RuleFacts
from dextera_build.engine.reach import copy_of
from dextera_build.engine.states import State
from dextera_build.errors import DxbError
from dextera_build.store.entry import ActionResult
from dextera_build.store.traces.steps import Steps

T = TypeVar("T")
Path = tuple[str, ...]
"""Names from the root of the graph."""
Labels = tuple[str, ...]
"""One label for each enclosing group, from the outside in."""

_NOBODY: list[Any] = []
_NOTHING: dict[str, Any] = {}
"""Stand for every empty list and mapping of units; never filled."""
_FEW = 8
_UNKNOWN = bytes(32)
"""Stands for a digest that is not known; no content has it."""
_SECONDS = struct.Struct("d")
_NO_FACTS = 2 * _UNKNOWN + _SECONDS.pack(0.0)
_TOLD = frozenset({"lost", "reads", "calls", "remote"})
"""What is kept of a node that is done."""


class Rare(Generic[T]):
    """What few units have at a time: a slot would take 8 bytes in all of them, and a number in it 32 more."""

    def __init__(self, default: T) -> None:
        self._default = default

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, unit: Unit, owner: type) -> T:
        found: T = unit.more.get(self._name, self._default)
        return found

    def __set__(self, unit: Unit, value: T) -> None:
        more = unit.more
        if value != self._default:
            if more is _NOTHING:
                more = unit.more = {}
            more[self._name] = value
        elif self._name in more:
            del more[self._name]


class Digest:
    """A digest that is one of the facts of a node.

    Args:
        place: Where it begins.
    """

    def __init__(self, place: int) -> None:
        self._part = slice(place, place + 32)

    def __get__(self, node: Node, owner: type) -> str | None:
        kept = node.facts[self._part]
        return kept.hex() if kept != _UNKNOWN else None

    def __set__(self, node: Node, value: str | None) -> None:
        facts, part = node.facts, self._part
        node.facts = facts[: part.start] + (bytes.fromhex(value) if value else _UNKNOWN) + facts[part.stop :]


class Unit:
    """Something that becomes known during a run.

    Args:
        address: Names it in events.
        path: Its call or group.
        labels: Of the copy that it stands in.

    Attributes:
        state: See `states`.
        pending: How many sources are not known yet.
        sources: What this one reads from.
        dependents: What waits for this one; emptied when it becomes known.
        more: The attributes that are `Rare`.
    """

    __slots__ = ("_path", "address", "dependents", "labels", "more", "pending", "sources", "state")

    lost = Rare[Counter[str] | None](None)
    """Blobs that it reads and that were found to be gone, with how often."""

    def __init__(self, *, address: str, path: Path, labels: Labels) -> None:
        self.address, self.labels = address, labels
        self._path = path if path != (address,) else None
        self.state = State.WAITS
        self.pending = 0
        self.sources: Sequence[Unit] = _NOBODY
        self.dependents: Sequence[Unit] = _NOBODY
        self.more: MutableMapping[str, Any] = _NOTHING

    def __repr__(self) -> str:
        """For a fault in dxb."""
        return f"{type(self).__name__} {self.address}"

    @property
    def path(self) -> Path:
        """The address of its call or group, without labels."""
        return self._path or (self.address,)

    def await_(self, sources: Iterable[Unit]) -> None:
        """Depend on all of `sources` too, and wait for those that are not known."""
        more = tuple(sources)
        if self.sources:
            held: list[Unit] = self.sources if isinstance(self.sources, list) else [*self.sources]
            held.extend(more)
            self.sources = held
        else:
            self.sources = more
        for source in more:
            if source.state is not State.DONE:
                self.pending += 1
                source._let_wait(self)

    def _let_wait(self, reader: Unit) -> None:
        waiting = self.dependents
        if len(waiting) < _FEW:
            self.dependents = (*waiting, reader)  # half of what a list of three takes
        elif isinstance(waiting, list):
            waiting.append(reader)
        else:
            self.dependents = [*waiting, reader]

    def release(self) -> Sequence[Unit]:
        """It is known: what waited for it."""
        waiting, self.dependents = self.dependents, _NOBODY
        return waiting

    def forget(self) -> None:
        """Drop all sources, so that they can be connected again."""
        for source in self.sources:
            if self in source.dependents:
                source.dependents = [other for other in source.dependents if other is not self]
        self.sources, self.pending = _NOBODY, 0


class Node(Unit):
    """One copy of a call.

    Args:
        address: `body[mug].mesh`.
        path: The call.
        labels: Which copy of it.
        graph: Has the call.

    Attributes:
        status: What it came to; one of `events.Status`, "" as long as that is open.
        facts: Key, output and `made_s`, 32 + 32 + 8 bytes: as one they take 112, each by itself 192.
        asked: Somebody reads its bytes or wants them; else it is enough to know its result.
        bare: Its result is known, and bytes of it may be absent.
    """

    __slots__ = ("_rule", "asked", "bare", "facts", "graph", "status")

    key = Digest(0)
    output = Digest(32)
    """What it returned, the last time that it was done."""
    leaves = Rare[list[tuple[Leaf, str]]](_NOBODY)
    """Files and folders that it reads directly, with the digests that entered its key; until it is done."""
    inputs = Rare[dict[str, str]](_NOTHING)
    """Slot -> digest; until it is done."""
    document = Rare[bytes](b"")
    """The key document, while it is looked up, and when it has run."""
    ticket = Rare[int](-1)
    """Names its run at the executor."""
    result = Rare[ActionResult | None](None)
    """Until it was told of."""
    error = Rare[DxbError | None](None)
    seconds = Rare[float](0.0)
    """How long it ran here [s], also when it failed, or was fetched."""
    remote = Rare[str]("")
    """Name of the remote that its result was fetched from."""
    log = Rare[str | None](None)
    """Digest of what a failed run printed."""
    usage = Rare[Mapping[str, float]](_NOTHING)
    """What its last run here used; see `usage.Usage`."""
    tries = Rare[int](0)
    """How often it ran here."""
    calls = Rare[tuple[Mapping[str, Any], ...]](())
    """What it called when it ran here, as `store.calls` notes it."""
    reads = Rare[Steps](())
    """What it reads by itself, as far as is known."""
    owned = Rare[str]("")
    """The key that it had when it became the one to build it."""
    rests_until = Rare[float](0.0)
    """Not before this is it tried again, by `time.monotonic`."""
    followers = Rare[list["Node"]](_NOBODY)
    """Nodes with the same key that wait for this one."""

    def __init__(self, *, address: str, path: Path, labels: Labels, graph: Graph) -> None:
        super().__init__(address=address, path=path, labels=labels)
        self.graph = graph
        self._rule: RuleFacts | None = None
        self.facts = _NO_FACTS
        self.status = ""
        self.asked = self.bare = False

    @property
    def call(self) -> Call:
        """What it is a copy of; made anew where the graph holds texts, for as objects calls would outweigh all else."""
        return copy_of(self.graph, self.path, self.labels)

    @property
    def made_s(self) -> float:
        """How long the run took that made its result [s]."""
        seconds: float = _SECONDS.unpack_from(self.facts, 64)[0]
        return seconds

    @made_s.setter
    def made_s(self, seconds: float) -> None:
        self.facts = self.facts[:64] + _SECONDS.pack(seconds)

    @property
    def rule(self) -> RuleFacts:
        """That of its call, which is asked for more often than all else of a call."""
        if self._rule is None:
            self._rule = self.call.rule
        return self._rule

    @rule.setter
    def rule(self, rule: RuleFacts) -> None:
        self._rule = rule

    def rest(self, *also: str) -> None:
        """It is done and was told of: of the `Rare` attributes keep what a record of it cannot find elsewhere."""
        if self.status == "fetched":
            also += ("seconds",)
        if self.tries > 1:
            also += ("tries",)
        self.more = {name: value for name, value in self.more.items() if name in _TOLD or name in also} or _NOTHING

    def follow(self, owner: Node) -> None:
        """Wait for `owner`, which has the same key."""
        if owner.followers:
            owner.followers.append(self)
        else:
            owner.followers = [self]

    def let_go(self) -> list[Node]:
        """Those that still wait for this one because they have its key; from here on they do not."""
        followers = self.followers
        if not followers:
            return followers
        self.followers = _NOBODY
        return [follower for follower in followers if follower.state is State.SHARED]


class Opening(Unit):
    """A group in one scope; known when its collection is.

    Attributes:
        items: Label -> digest of the item.
    """

    __slots__ = ("group", "items")

    def __init__(self, *, address: str, path: Path, labels: Labels, group: Group) -> None:
        super().__init__(address=address, path=path, labels=labels)
        self.group = group
        self.items: dict[str, str] = {}


class Gathering(Unit):
    """All copies of one call within a scope; `labels` are those of the scope.

    With `collect` their outputs become a `Collection`; without, it only asks for the copies, as a target does.

    Attributes:
        nodes: The copies, as far as groups are open.
        output: Digest of the collection.
    """

    __slots__ = ("collect", "fields", "nodes", "output")

    def __init__(
        self, *, address: str, path: Path, labels: Labels, collect: bool, fields: tuple[str, ...] = ()
    ) -> None:
        super().__init__(address=address, path=path, labels=labels)
        self.collect, self.fields = collect, fields
        self.nodes: dict[Labels, Node] = {}
        self.output: str | None = None


def producers(unit: Unit) -> Iterator[Node]:
    """The nodes whose outputs `unit` reads, through openings and gatherings."""
    seen: set[int] = set()
    stack = [*reversed(unit.sources)]
    while stack:
        source = stack.pop()
        if id(source) in seen:
            continue
        seen.add(id(source))
        if isinstance(source, Node):
            yield source
        else:
            stack += reversed(source.sources)
