"""The units of a run: nodes, groups to open, and collections to gather."""

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
"""One label for each enclosing group, outermost first."""


@dataclass(kw_only=True, eq=False, repr=False, slots=True)
class Unit:
    """A part of the graph whose value becomes known during a run."""

    address: str
    """Its name in events."""
    path: Path
    """The address of its call or group, without labels."""
    labels: Labels
    """Labels of the copy that contains it."""
    state: State = State.WAITS
    pending: int = 0
    """Number of sources that are not known yet."""
    sources: list[Unit] = field(default_factory=list)
    """Units that this one reads."""
    dependents: list[Unit] = field(default_factory=list)
    """Units that wait for this one; emptied when it becomes known."""
    lost: Counter[str] | None = None
    """Digest of a blob that was missing when read -> how often."""

    def __repr__(self) -> str:
        """Text for assertion messages."""
        return f"{type(self).__name__} {self.address}"

    def await_(self, sources: Iterable[Unit]) -> None:
        """Add `sources`, and wait for those that are not known yet."""
        for source in sources:
            self.sources.append(source)
            if source.state is not State.DONE:
                self.pending += 1
                source.dependents.append(self)

    def release(self) -> list[Unit]:
        """Return the units that waited for this one, which is known now."""
        waiting, self.dependents = self.dependents, []
        return waiting

    def leave_out(self, source: Unit) -> None:
        """Go on without `source`, which will never be known."""
        self.sources.remove(source)
        self.pending -= 1
        source.dependents = [other for other in source.dependents if other is not self]

    def forget(self) -> None:
        """Drop all sources, so that the unit can be reconnected."""
        for source in self.sources:
            if self in source.dependents:
                source.dependents = [other for other in source.dependents if other is not self]
        self.sources, self.pending = [], 0


@dataclass(kw_only=True, eq=False, repr=False, slots=True)
class Node(Unit):
    """One copy of a call."""

    call: Call
    status: Status | None = None
    """The outcome; None while it is open."""
    asked: bool = False
    """Whether its bytes are needed; otherwise its result is enough."""
    bare: bool = False
    """Its result is known, but some of its bytes may be absent."""
    inputs: dict[str, str] = field(default_factory=dict)
    """Slot -> digest."""
    leaves: list[tuple[Leaf, str]] = field(default_factory=list)
    """Files and folders that it reads directly, with the digests used in its key."""
    reads: Steps | None = None
    """Its discovered inputs; None if unknown."""
    key: str | None = None
    document: bytes = b""
    """The key document, during the lookup and after the run."""
    owned: str = ""
    """Key that this node was chosen to build."""
    followers: list[Node] = field(default_factory=list)
    """Nodes with the same key that wait for this one."""
    ticket: int = -1
    """Identifies its run to the executor."""
    tries: int = 0
    """Number of runs in this build."""
    rests_until: float = 0.0
    """Earliest time of the next try, by `time.monotonic`."""
    last: Ended | None = None
    """Report of its last run in this build."""
    result: ActionResult | None = None
    """Its most recent result."""
    error: DxbError | None = None
    log: str | None = None
    """Digest of the output of a failed run."""
    remote: str = ""
    """Name of the remote that its result was fetched from."""
    fetched_s: float = 0.0
    """Duration of the fetch [s]."""

    @property
    def rule(self) -> RuleFacts:
        """The rule of its call."""
        return self.call.rule

    @property
    def output(self) -> str | None:
        """Digest of its most recent output."""
        return self.result.output if self.result is not None else None

    def let_go(self) -> list[Node]:
        """Release and return the followers that still wait for this node's key."""
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

    With `collect`, their outputs become a `Collection`; without it, the copies are only requested, as by a target.
    """

    collect: bool
    fields: tuple[str, ...] = ()
    nodes: dict[Labels, Node] = field(default_factory=dict)
    """The copies in the groups opened so far."""
    output: str | None = None
    """Digest of the collection."""

    def leave_out(self, source: Unit) -> None:
        """Go on without `source`, and without its copy."""
        Unit.leave_out(self, source)  # `super()` does not work in a class that slots replaced
        if isinstance(source, Node):
            del self.nodes[source.labels]


class States:
    """The states of all units of one run, and the queues derived from them."""

    def __init__(self) -> None:
        self.ready: deque[Unit] = deque()
        self.queue: deque[Node] = deque()
        self.locked: list[Node] = []
        self.running = 0
        self.fetching = 0

    def set(self, unit: Unit, state: State) -> None:
        """Change the state of a unit; the only place that does.

        Raises:
            AssertionError: The diagram in `states.py` has no such transition.
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
    """How a node ended outside the scheduler: with a result or an error; with neither if it has to run."""

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
