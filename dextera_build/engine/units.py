"""What a run is made of: nodes, groups that open, and collections that are gathered."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from dextera_build.engine.graph import Call, Group, Input, Leaf
from dextera_build.engine.states import State
from dextera_build.errors import DxbError
from dextera_build.store.actions import ActionResult
from dextera_build.store.traces.steps import Steps

Path = tuple[str, ...]
"""Names from the root of the graph."""
Labels = tuple[str, ...]
"""One label for each enclosing group, from the outside in."""


_NOBODY: list[Any] = []
_NOTHING: dict[str, Any] = {}
"""Stand for every empty list and mapping of units, so that a hundred thousand of them take no room; never filled."""


@dataclass(eq=False, kw_only=True, slots=True)
class Unit:
    """Something that becomes known during a run."""

    address: str
    path: Path
    labels: Labels
    state: State = State.WAITS
    pending: int = 0
    """How many sources are not known yet."""
    sources: list[Unit] = field(default_factory=lambda: _NOBODY, repr=False)
    """What this one reads from."""
    dependents: list[Unit] = field(default_factory=lambda: _NOBODY, repr=False)
    """What waits for this one; emptied when it becomes known."""
    lost: Counter[str] | None = field(default=None, repr=False)
    """Blobs that it reads and that were found to be gone, with how often."""

    def await_(self, source: Unit) -> None:
        """Depend on `source`, and wait for it unless it is known."""
        if self.sources:
            self.sources.append(source)
        else:
            self.sources = [source]
        if source.state is not State.DONE:
            self.pending += 1
            if source.dependents:
                source.dependents.append(self)
            else:
                source.dependents = [self]

    def release(self) -> list[Unit]:
        """It is known: what waited for it. How it became known is forgotten, and found anew where that is needed."""
        waiting, self.dependents = self.dependents, _NOBODY
        if isinstance(self, Node | Packing):
            self.links = _NOTHING
        return waiting

    def forget(self) -> None:
        """Drop all sources, so that they can be connected again."""
        for source in self.sources:
            if self in source.dependents:
                source.dependents = [other for other in source.dependents if other is not self]
        self.sources, self.pending = _NOBODY, 0


@dataclass(eq=False, kw_only=True, slots=True)
class Node(Unit):
    """One copy of a call."""

    call: Call
    links: dict[str, Link] = field(default_factory=lambda: _NOTHING, repr=False)
    leaves: list[tuple[Leaf, str]] = field(default_factory=lambda: _NOBODY, repr=False)
    """Files and folders that it reads directly, with the digests that entered its key."""
    inputs: dict[str, str] = field(default_factory=lambda: _NOTHING)
    key: str | None = None
    document: bytes = field(default=b"", repr=False)
    """The key document, while it is looked up, and until it runs where few nodes wait; in a dry run also later."""
    ticket: int = -1
    """Names its run at the executor."""
    status: str = ""
    """What it came to; one of `events.Status`, or "" as long as that is open."""
    result: ActionResult | None = None
    error: DxbError | None = None
    seconds: float = 0.0
    """How long it ran here [s], also when it failed."""
    remote: str = ""
    """Name of the remote that its result was fetched from."""
    log: str | None = None
    """Digest of what a failed run printed."""
    usage: Mapping[str, float] = field(default_factory=lambda: _NOTHING)
    """What its last run here used; see `usage.Usage`."""
    tries: int = 0
    """How often it ran here."""
    calls: tuple[Mapping[str, Any], ...] = ()
    """What it called when it ran here, as `store.calls` notes it."""
    reads: Steps = ()
    """What it reads by itself, as far as is known."""
    owned: str = ""
    """The key that it had when it became the one to build it."""
    rests_until: float = 0.0
    """Not before this is it tried again, by `time.monotonic`."""
    asked: bool = False
    """Somebody reads its bytes or wants them; else it is enough to know its result."""
    bare: bool = False
    """Its result is known, and bytes of it may be absent."""
    followers: list[Node] = field(default_factory=lambda: _NOBODY, repr=False)
    """Nodes with the same key that wait for this one."""

    def follow(self, owner: Node) -> None:
        """Wait for `owner`, which has the same key."""
        if owner.followers:
            owner.followers.append(self)
        else:
            owner.followers = [self]

    def let_go(self) -> list[Node]:
        """Those that still wait for this one because they have its key; from here on they do not."""
        followers, self.followers = self.followers, _NOBODY
        return [follower for follower in followers if follower.state is State.SHARED]


@dataclass(eq=False, kw_only=True, slots=True)
class Opening(Unit):
    """A group in one scope; known when its collection is."""

    group: Group
    over: Link | None = field(default=None, repr=False)
    items: dict[str, str] = field(default_factory=dict)
    """Label -> digest of the item."""


@dataclass(eq=False, kw_only=True, slots=True)
class Gathering(Unit):
    """All copies of one call within a scope; `labels` are those of the scope.

    With `collect` their outputs become a `Collection`; without, it only asks for the copies, as a target does.
    """

    collect: bool
    fields: tuple[str, ...] = ()
    nodes: dict[Labels, Node] = field(default_factory=dict, repr=False)
    output: str | None = None


@dataclass(eq=False, kw_only=True, slots=True)
class Packing(Unit):
    """A collection that one reader lists by label; `path` and `labels` are the reader's."""

    parts: Mapping[str, Input]
    links: dict[str, Link] = field(default_factory=lambda: _NOTHING, repr=False)
    output: str | None = None


@dataclass(frozen=True, slots=True)
class Link:
    """Where the digest of one input comes from: known at once, or a unit with a path into what it gives."""

    unit: Unit | None = None
    fields: tuple[str, ...] = ()
    label: str | None = None
    """The item of an opening."""
    digest: str | None = None


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
