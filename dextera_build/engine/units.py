"""What a run is made of: nodes, groups that open, and collections that are gathered."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from dextera_build.engine.graph import Call, Group, Leaf, RuleFacts
from dextera_build.engine.states import NEXT, State
from dextera_build.errors import DxbError
from dextera_build.runs.events import Status
from dextera_build.store.entry import ActionResult
from dextera_build.store.traces import Steps
from dextera_build.workers.protocol import Ended

Path = tuple[str, ...]
"""Names from the root of the graph."""
Labels = tuple[str, ...]
"""One label for each enclosing group, from the outside in."""


@dataclass(kw_only=True, eq=False, repr=False, slots=True)
class Unit:
    """Something that becomes known during a run."""

    address: str
    """Names it in events."""
    path: Path
    """The address of its call or group, without labels."""
    labels: Labels
    """Those of the copy that it stands in."""
    state: State = State.WAITS
    pending: int = 0
    """How many sources are not known yet."""
    sources: list[Unit] = field(default_factory=list)
    """What this one reads from."""
    dependents: list[Unit] = field(default_factory=list)
    """What waits for this one; emptied when it becomes known."""
    lost: Counter[str] | None = None
    """Blobs that it reads and that were found to be gone, with how often."""

    def __repr__(self) -> str:
        """For a fault in dxb."""
        return f"{type(self).__name__} {self.address}"

    def await_(self, sources: Iterable[Unit]) -> None:
        """Depend on all of `sources` too, and wait for those that are not known."""
        for source in sources:
            self.sources.append(source)
            if source.state is not State.DONE:
                self.pending += 1
                source.dependents.append(self)

    def release(self) -> list[Unit]:
        """It is known: what waited for it."""
        waiting, self.dependents = self.dependents, []
        return waiting

    def forget(self) -> None:
        """Drop all sources, so that they can be connected again."""
        for source in self.sources:
            if self in source.dependents:
                source.dependents = [other for other in source.dependents if other is not self]
        self.sources, self.pending = [], 0


@dataclass(kw_only=True, eq=False, repr=False, slots=True)
class Node(Unit):
    """One copy of a call."""

    call: Call
    status: Status | None = None
    """What it came to; None as long as that is open."""
    asked: bool = False
    """Somebody reads its bytes or wants them; else it is enough to know its result."""
    bare: bool = False
    """Its result is known, and bytes of it may be absent."""
    inputs: dict[str, str] = field(default_factory=dict)
    """Slot -> digest."""
    leaves: list[tuple[Leaf, str]] = field(default_factory=list)
    """Files and folders that it reads directly, with the digests that entered its key."""
    reads: Steps | None = None
    """What it reads by itself, None where that is not known."""
    key: str | None = None
    document: bytes = b""
    """The key document, while it is looked up, and when it has run."""
    owned: str = ""
    """The key that it had when it became the one to build it."""
    followers: list[Node] = field(default_factory=list)
    """Nodes with the same key that wait for this one."""
    ticket: int = -1
    """Names its run at the executor."""
    tries: int = 0
    """How often it ran here."""
    rests_until: float = 0.0
    """Not before this is it tried again, by `time.monotonic`."""
    last: Ended | None = None
    """How its last run here ended."""
    result: ActionResult | None = None
    """That of the last time that it was done."""
    error: DxbError | None = None
    log: str | None = None
    """Digest of what a failed run printed."""
    remote: str = ""
    """Name of the remote that its result was fetched from."""
    fetched_s: float = 0.0
    """How long that took [s]."""

    @property
    def rule(self) -> RuleFacts:
        """That of its call."""
        return self.call.rule

    @property
    def output(self) -> str | None:
        """What it returned, the last time that it was done."""
        return self.result.output if self.result is not None else None

    def let_go(self) -> list[Node]:
        """Those that still wait for this one because they have its key; from here on they do not."""
        followers, self.followers = self.followers, []
        return [follower for follower in followers if follower.state is State.SHARED]


@dataclass(kw_only=True, eq=False, repr=False, slots=True)
class Opening(Unit):
    """A group in one scope; known when its collection is."""

    group: Group
    items: dict[str, str] = field(default_factory=dict)
    """Label -> digest of the item."""


@dataclass(kw_only=True, eq=False, repr=False, slots=True)
class Gathering(Unit):
    """All copies of one call within a scope; `labels` are those of the scope.

    With `collect` their outputs become a `Collection`; without, it only asks for the copies, as a target does.
    """

    collect: bool
    fields: tuple[str, ...] = ()
    nodes: dict[Labels, Node] = field(default_factory=dict)
    """The copies, as far as groups are open."""
    output: str | None = None
    """Digest of the collection."""


class States:
    """The states of all units of one run, with the queues that follow from them."""

    def __init__(self) -> None:
        self.ready: deque[Unit] = deque()
        self.queue: deque[Node] = deque()
        self.locked: list[Node] = []
        self.running = 0
        self.fetching = 0

    def set(self, unit: Unit, state: State) -> None:
        """Every change of state goes through here.

        Raises:
            AssertionError: The picture in `states.py` has no such arrow.
        """
        old = unit.state
        if state not in NEXT[old]:
            raise AssertionError(f"{unit}: {old.value} -> {state.value}")
        unit.state = state
        if state is State.READY:
            self.ready.append(unit)
        if isinstance(unit, Node):
            if old is State.LOCKED:
                self.locked.remove(unit)
            self.running += (state is State.RUNNING) - (old is State.RUNNING)
            self.fetching += (state is State.FETCHING) - (old is State.FETCHING)
            if state is State.QUEUED:
                self.queue.append(unit)
            elif state is State.LOCKED:
                self.locked.append(unit)

    def next_ready(self) -> Unit | None:
        """Take the next unit whose sources are known."""
        while self.ready:
            unit = self.ready.popleft()
            if unit.state is State.READY:
                return unit
        return None


class End(NamedTuple):
    """What became of a node elsewhere than in the scheduler: a result or an error; neither, where it has to run."""

    node: Node
    status: Status | None = None
    result: ActionResult | None = None
    bare: bool = False
    error: DxbError | None = None


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
