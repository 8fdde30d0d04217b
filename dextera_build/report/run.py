"""A run read back from its events, the basis of every view of it."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from dextera_build.report import sources
from dextera_build.report.sources import Store
from dextera_build.runs.costs import Costs
from dextera_build.runs.events import Event

_STEP = re.compile(r"(?P<name>[^.\[]+)(?:\[(?P<label>[^\]]*)\])?(?:\.|$)")
_WORKED = ("ran", "fetched", "failed", "cancelled")


@dataclass
class Node:
    """One node of the run, with its record in the store."""

    index: int
    address: str
    rule: str
    backend: str | None
    status: str
    key: str | None
    output: str | None
    began: float
    """Seconds since the run began."""
    ended: float
    """Seconds since the run began."""
    line: str = ""
    error: Mapping[str, Any] | None = None
    blocked_by: list[str] = field(default_factory=list)
    inputs: dict[str, str] = field(default_factory=dict)
    depends_on: list[str] = field(default_factory=list)
    previews: list[tuple[str, str]] = field(default_factory=list)
    metrics: dict[str, tuple[float, str]] = field(default_factory=dict)
    log: str = ""
    first_seconds: float = 0.0
    """Its duration when it ran, in this run or an earlier one [s]."""
    document: dict[str, Any] = field(default_factory=dict)
    again: tuple[str, ...] = ()
    """Digests of other outputs that reruns of its key gave."""
    artifact: str = ""
    fields: dict[str, Any] = field(default_factory=dict)
    usage: Mapping[str, float] = field(default_factory=dict)
    """Its resource usage in this run; see `Ended.usage`."""
    tries: int = 0
    calls: list[Mapping[str, Any]] = field(default_factory=list)
    """Recorded calls behind its result."""

    @property
    def seconds(self) -> float:
        """Time it took in this run [s]."""
        return max(0.0, self.ended - self.began)

    @property
    def worked(self) -> bool:
        """Whether it took a worker in this run."""
        return self.status in _WORKED and self.seconds > 0

    @property
    def steps(self) -> list[tuple[str, str | None]]:
        """(name, label) of every part of the address."""
        return [(m["name"], m["label"]) for m in _STEP.finditer(self.address)]

    @property
    def call(self) -> tuple[str, ...]:
        """The address without labels, as the recipe declares it."""
        return tuple(name for name, _ in self.steps)

    @property
    def labels(self) -> tuple[str, ...]:
        """One label per enclosing group."""
        return tuple(label for _, label in self.steps[:-1] if label is not None)

    @property
    def name(self) -> str:
        """The last part of the address, without another recipe's name."""
        return self.steps[-1][0].rpartition(":")[2] if self.steps else self.address


@dataclass
class Run:
    """One build."""

    name: str = ""
    recipe: str = ""
    targets: list[str] = field(default_factory=list)
    profile: str = ""
    dxb: str = ""
    argv: list[str] = field(default_factory=list)
    started: float = 0.0
    """Seconds since the epoch."""
    seconds: float = 0.0
    saved: float = 0.0
    ok: bool = False
    interrupted: bool = True
    counts: dict[str, int] = field(default_factory=dict)
    nodes: list[Node] = field(default_factory=list)
    groups: dict[str, list[str]] = field(default_factory=dict)
    """Group -> labels."""
    chosen: dict[str, str] = field(default_factory=dict)
    """`factorize.mesh: primitives` -> who chose it."""
    costs: Costs = field(default_factory=Costs)
    """Cost of requests to services."""

    def by_address(self) -> dict[str, Node]:
        """Address -> node."""
        return {node.address: node for node in self.nodes}


def read(events: Iterable[Event | Mapping[str, Any]], store: Store) -> Run:
    """The run described by `events`, completed from `store`; an event log may be truncated."""
    run = Run()
    reader = _Reader(run)
    for event in events:
        reader.take(json.loads(event.to_line()) if isinstance(event, Event) else event)
    reader.end()
    for node in run.nodes:
        printed = sources.text(store, reader.printed.get(node.address)).strip()
        _complete(node, store, printed or "\n".join(reader.logs.get(node.address, [])))
    return run


class _Reader:
    """Fills a run from its events; unknown kinds are ignored."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.begun: dict[str, Mapping[str, Any]] = {}
        self.logs: dict[str, list[str]] = {}
        self.printed: dict[str, str | None] = {}
        self.ended: dict[str, tuple[Mapping[str, Any], Mapping[str, Any] | None]] = {}
        self.last = 0.0

    def take(self, data: Mapping[str, Any]) -> None:
        """Process one event."""
        self.last = max(self.last, float(data.get("time", 0.0)))
        kind = data["event"]
        if kind == "run_started":
            _start(self.run, data)
        elif kind == "group_opened":
            self.run.groups[data["group"]] = list(data["labels"])
        elif kind == "node_started":
            self.begun[data["node"]] = data
        elif kind == "node_paid":
            self.run.costs.add(data["service"], float(data["usd"]), sure=bool(data.get("sure", True)))
        elif kind == "node_log":
            self.logs.setdefault(data["node"], []).append(data["text"])
        elif kind == "node_finished":
            # A node whose bytes were lost runs again: its last event counts.
            self.ended[data["node"]] = (data, self.begun.pop(data["node"], None))
            self.printed[data["node"]] = data.get("log")
        elif kind == "run_finished":
            _finish(self.run, data)

    def end(self) -> None:
        """Mark unfinished nodes as cancelled; if the run's final event is missing, count the nodes seen."""
        run = self.run
        for data in self.begun.values():
            lost = {"status": "cancelled", "output": None, "time": self.last, "seconds": self.last - data["time"]}
            self.ended[data["node"]] = ({**data, **lost}, data)
        for finished, begun in self.ended.values():
            run.nodes.append(_node(run, finished, begun))
        if not run.counts:
            run.seconds = self.last - run.started
            run.counts = dict(Counter(node.status for node in run.nodes))


def _start(run: Run, data: Mapping[str, Any]) -> None:
    run.name, run.recipe, run.profile, run.dxb = data["run"], data["recipe"], data["profile"], data["dxb"]
    run.chosen = dict(data.get("backends", {}))
    run.targets, run.argv, run.started = list(data["targets"]), list(data.get("argv", [])), float(data["time"])


def _finish(run: Run, data: Mapping[str, Any]) -> None:
    run.ok, run.interrupted = bool(data["ok"]), bool(data.get("interrupted", False))
    run.seconds, run.saved, run.counts = float(data["seconds"]), float(data["saved_seconds"]), dict(data["counts"])


def _node(run: Run, data: Mapping[str, Any], begun: Mapping[str, Any] | None) -> Node:
    ended = float(data["time"]) - run.started
    worked = data["status"] in _WORKED
    began = float(begun["time"]) - run.started if begun else ended - float(data["seconds"])
    return Node(
        index=len(run.nodes),
        address=data["node"],
        rule=data["rule"],
        backend=data.get("backend"),
        status=data["status"],
        key=data.get("key"),
        output=data.get("output"),
        began=began if worked else ended,
        ended=ended,
        line=data.get("line") or "",
        error=data.get("error"),
        blocked_by=list(data.get("blocked_by", ())),
        inputs=dict(data.get("inputs", {})),
        depends_on=list(data.get("depends_on", ())),
        usage=dict(data.get("usage", {})),
        tries=int(data.get("tries", 0)),
        calls=list(data.get("calls", ())),
    )


def _complete(node: Node, store: Store, log: str) -> None:
    found = sources.result(store, node.key)
    node.log = log
    node.first_seconds = node.seconds
    if found is not None:
        node.line = node.line or found.line
        node.previews = [(str(caption), str(digest)) for caption, digest in found.previews]
        node.metrics = {name: (float(value), unit) for name, (value, unit) in found.metrics.items()}
        node.first_seconds = found.seconds
        node.log = node.log or sources.text(store, found.log).strip()
    node.document = sources.document(store, found)
    node.again = sources.again(store, node.key)
    node.artifact, node.fields = sources.header(store, node.output)
    if not node.inputs:
        node.inputs = dict(node.document.get("inputs", ()))
