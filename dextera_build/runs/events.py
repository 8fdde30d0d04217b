"""Events of the engine, one per line. Consoles, the report and `dxb log` are views of this stream."""

from __future__ import annotations

import json
import types
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields
from functools import cache
from typing import Any, ClassVar, Literal, TypeAlias, get_args, get_origin, get_type_hints

from dextera_build.errors import DxbError
from dextera_build.redact import redact

Status: TypeAlias = Literal["cached", "ran", "fetched", "failed", "waits", "cancelled"]


def _plain(value: Any) -> object:
    return value.to_json() if isinstance(value, DxbError) else dict(value)


_spell = json.JSONEncoder(sort_keys=True, ensure_ascii=False, default=_plain).encode


@dataclass(frozen=True)
class Event:
    """Base of all events; `time` is seconds since the epoch."""

    kind: ClassVar[str] = ""
    time: float

    def to_line(self) -> str:
        """One JSON line with the event's kind under `event`."""
        return _spell({"event": self.kind, **self.__dict__})


@dataclass(frozen=True)
class RunStarted(Event):
    """A build began."""

    kind: ClassVar[str] = "run_started"
    run: str
    recipe: str
    targets: list[str]
    profile: str
    dxb: str
    calls: int
    groups: int
    argv: list[str] = field(default_factory=list)
    variant: str = ""
    """Distinguishes the request from the recipe's default."""
    workspace: str = ""
    """Distinguishes the project from others that share the store; see `workspaces.mark`."""
    backends: Mapping[str, str] = field(default_factory=dict)
    """`factorize.mesh: primitives` -> its origin, and the skipped backends."""
    instead: list[str] = field(default_factory=list)
    """Lines about backends that are taken because preferred ones are missing."""

    def __post_init__(self) -> None:
        # The command line may contain passwords of remotes; logs and reports are shared.
        object.__setattr__(self, "argv", [redact(word) for word in self.argv])


@dataclass(frozen=True)
class GroupOpened(Event):
    """A group's collection is known; its calls have one copy for each label."""

    kind: ClassVar[str] = "group_opened"
    group: str
    labels: list[str]


@dataclass(frozen=True)
class RunSized(Event):
    """How many nodes the targets need so far; unopened groups may add more."""

    kind: ClassVar[str] = "run_sized"
    nodes: int
    unopened: int
    """Groups that are not open yet; a nested group counts once the outer one is open."""


@dataclass(frozen=True)
class NodeStarted(Event):
    """A node began to run on a worker."""

    kind: ClassVar[str] = "node_started"
    node: str
    rule: str
    backend: str | None
    key: str
    last_seconds: float | None = None


@dataclass(frozen=True)
class NodeProgress(Event):
    """A running node reports its progress."""

    kind: ClassVar[str] = "node_progress"
    node: str
    done: int
    total: int
    what: str


@dataclass(frozen=True)
class NodeLog(Event):
    """A running node logged a line."""

    kind: ClassVar[str] = "node_log"
    node: str
    text: str


@dataclass(frozen=True)
class NodePaid(Event):
    """A running node sent a request that costs money to a service."""

    kind: ClassVar[str] = "node_paid"
    node: str
    service: str
    model: str
    usd: float
    """Its cost [USD], as reported by the service or by its stated price."""
    sure: bool = True
    """False: the answer was lost, and the service may not have charged it."""


@dataclass(frozen=True)
class BytesMissed(Event):
    """`reader` needs the bytes of a known result that the store lacks; they are fetched or rebuilt.

    A node that is itself requested is its own reader.
    """

    kind: ClassVar[str] = "bytes_missed"
    node: str
    reader: str


@dataclass(frozen=True)
class NodeRetried(Event):
    """A node failed and is retried in `wait_s` seconds; `log` is the digest of its output."""

    kind: ClassVar[str] = "node_retried"
    node: str
    tries: int
    """Number of runs so far."""
    wait_s: float
    error: Mapping[str, Any]
    log: str | None = None


@dataclass(frozen=True)
class NodeFinished(Event):
    """A node is settled: the event, and the node's record in the result of the run.

    Status `waits` means that the node never ran because `blocked_by` failed. `result` is the digest of the node's
    result document, `log` that of its printed output (also of a failed run). A node whose bytes turn out to be lost
    may finish twice in a run; the last event counts. A group that cannot be opened fails like a node, with rule
    `each`. `files` maps slots (`photo`, or `photos[left]` of a listed collection) to the path of their file or folder,
    relative to the project folder if inside it. `usage` holds the resources used by the run; see `Ended.usage`.
    """

    kind: ClassVar[str] = "node_finished"
    node: str
    rule: str
    backend: str | None
    status: Status
    key: str | None
    output: str | None
    seconds: float
    """Duration of its run or fetch [s], in this run or, if cached, in the run that made it."""
    line: str = ""
    result: str | None = None
    error: DxbError | None = None
    """Error of a failed node; logs hold its plain data."""
    blocked_by: list[str] = field(default_factory=list)
    inputs: Mapping[str, str] = field(default_factory=dict)
    depends_on: list[str] = field(default_factory=list)
    log: str | None = None
    files: Mapping[str, str] = field(default_factory=dict)
    remote: str = ""
    """Name of the remote that a fetched result came from."""
    usage: Mapping[str, float] = field(default_factory=dict)
    tries: int = 0
    """Number of runs; 0 if it did not run."""
    calls: list[Mapping[str, Any]] = field(default_factory=list)
    """Recorded calls that the result used: `call`, and for those made in this run `service`, `model`, `how`, ..."""


@dataclass(frozen=True)
class RemoteGivenUp(Event):
    """A remote is not used for the rest of the run."""

    kind: ClassVar[str] = "remote_given_up"
    remote: str
    address: str
    doing: str
    """`read`, `write` or `both`."""
    reason: str


@dataclass(frozen=True)
class Uploading(Event):
    """All nodes are done, and the run waits for uploads."""

    kind: ClassVar[str] = "uploading"
    done: int
    total: int


@dataclass(frozen=True)
class Uploaded(Event):
    """The outcome of uploading this run's results to one remote."""

    kind: ClassVar[str] = "uploaded"
    remote: str
    results: int
    octets: int
    """Number of bytes transferred."""
    left: int
    """Number of results that were not uploaded."""
    reason: str
    """Why the first of them was not uploaded."""


@dataclass(frozen=True)
class RunFinished(Event):
    """The build ended."""

    kind: ClassVar[str] = "run_finished"
    ok: bool
    seconds: float
    counts: Mapping[str, int]
    saved_seconds: float
    interrupted: bool = False


Listener: TypeAlias = Callable[[Event], None]


def is_event(plain: object) -> bool:
    """Whether this is the plain data of an event; a known kind needs all its required fields, with the right types."""
    if not isinstance(plain, dict) or not isinstance(plain.get("event"), str):
        return False
    for name, needed, kinds in _forms().get(plain["event"], ()):
        if type(plain[name]) not in kinds if name in plain else needed:
            return False
    return True


@cache
def _forms() -> dict[str, list[tuple[str, bool, set[type]]]]:
    """Kind -> (field, whether it is required, its JSON types)."""
    found = {}
    for kind in Event.__subclasses__():
        hints = get_type_hints(kind)
        found[kind.kind] = [
            (one.name, one.default is one.default_factory is MISSING, {*_plain_types(hints[one.name])})
            for one in fields(kind)
        ]
    return found


def _plain_types(hint: Any) -> Iterator[type]:
    if get_origin(hint) is types.UnionType:
        for part in get_args(hint):
            yield from _plain_types(part)
    elif get_origin(hint) is Literal:
        yield str
    elif hint is float:
        yield from (int, float)
    else:
        yield {Mapping: dict, list: list, DxbError: dict}.get(get_origin(hint) or hint, hint)


def fan_out(*listeners: Listener) -> Listener:
    """One listener that passes every event to each of `listeners`, in order."""

    def listen(event: Event) -> None:
        for listener in listeners:
            listener(event)

    return listen
