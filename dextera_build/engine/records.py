"""What became of the nodes of a run."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from dextera_build.engine import events
from dextera_build.engine.states import State
from dextera_build.engine.units import Node
from dextera_build.engine.wiring import Wiring
from dextera_build.errors import DxbError
from dextera_build.store.actions import Actions
from dextera_build.store.cas import MissingBlob
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store


@dataclass(frozen=True, slots=True)
class NodeRecord:
    """What became of one node."""

    status: events.Status
    key: str | None
    output: str | None
    """Digest of the output's header."""
    seconds: float
    """How long it ran or was fetched [s], in this run or, for a cached one, when it was made."""
    line: str
    error: DxbError | None
    inputs: Mapping[str, str]
    """Slot -> digest."""
    rule: str = ""
    backend: str | None = None
    result: str | None = None
    """Digest of its `result.json`."""
    log: str | None = None
    """Digest of what it printed, also when it failed."""
    blocked_by: tuple[str, ...] = ()
    """Addresses of the failed nodes that it waits for."""
    usage: Mapping[str, float] = field(default_factory=dict)
    tries: int = 0
    """How often it ran in this run."""
    calls: tuple[Mapping[str, Any], ...] = ()
    """Recorded calls that its result came of; of those made in this run also service, amounts, and how."""


class Records(Mapping[str, NodeRecord]):
    """Records of the nodes that a run looked at, made when asked for.

    Args:
        nodes: By address.
        blockers: Address -> addresses of the failed nodes that it waits for.
        usage: What a node used that ran.
        store: Has what a node does not hold itself any more.
    """

    def __init__(
        self,
        nodes: Mapping[str, Node],
        blockers: Mapping[str, Sequence[str]],
        usage: Callable[[str], Mapping[str, float]],
        store: Store,
    ) -> None:
        self._nodes, self._blockers, self._usage = nodes, blockers, usage
        self._told = _Told(store)

    def statuses(self) -> Iterator[events.Status]:
        """Of all nodes, without their records."""
        return (status_of(node) for node in self._nodes.values())

    def errors(self) -> dict[str, DxbError]:
        """Address -> error of the nodes that failed."""
        return {address: node.error for address, node in self._nodes.items() if node.error is not None}

    def rule(self, address: str) -> str:
        """The rule of a node."""
        return self._nodes[address].rule.path

    def output(self, address: str) -> str | None:
        """The output of a node, None where it has none."""
        node = self._nodes[address]
        return node.output if node.state is State.DONE else None

    def __getitem__(self, address: str) -> NodeRecord:
        node = self._nodes[address]
        if node.state is not State.DONE or node.result is not None:
            return record_of(node, self._blockers.get(address, ()))
        result = self._told.result(node.key)
        usage = node.usage or (self._usage(address) if node.status == "ran" else {})
        return replace(
            record_of(node, (), result),
            inputs=_Inputs(self._told, result) if result else {},
            usage=usage,
            tries=node.tries or int(node.status == "ran"),
        )

    def __iter__(self) -> Iterator[str]:
        return iter(self._nodes)

    def __len__(self) -> int:
        return len(self._nodes)

    def __contains__(self, address: object) -> bool:
        return address in self._nodes


class _Told:
    """What the store says of results, for who only tells of them."""

    def __init__(self, store: Store) -> None:
        self._blobs = store.blobs
        # One of its own: what is only told of must not be noted as what the build found.
        self._actions = Actions(store.actions.root, store.blobs, store.recent)

    def result(self, key: str | None) -> ActionResult | None:
        return self._actions.known(key) if key else None

    def document(self, result: ActionResult) -> dict[str, Any]:
        try:
            found: dict[str, Any] = json.loads(self._blobs.get(result.key_document))
        except MissingBlob:
            return {"inputs": {}}
        return found


class _Inputs(Mapping[str, str]):
    """Slot -> digest, as the key document says; read when somebody asks, for to read a damaged one has effects."""

    def __init__(self, told: _Told, result: ActionResult) -> None:
        self._told, self._result = told, result

    @cached_property
    def _found(self) -> dict[str, str]:
        return dict(self._told.document(self._result)["inputs"])

    def __getitem__(self, slot: str) -> str:
        return self._found[slot]

    def __iter__(self) -> Iterator[str]:
        return iter(self._found)

    def __len__(self) -> int:
        return len(self._found)

    def __repr__(self) -> str:
        """For a failing test."""
        return repr(self._found)


def record_of(node: Node, blockers: Sequence[str] = (), result: ActionResult | None = None) -> NodeRecord:
    """What became of a node, from what it holds and, where it holds none, its result."""
    result, rule, done = node.result or result, node.rule, node.state is State.DONE
    made = result if done else None
    return NodeRecord(
        status=status_of(node),
        key=node.key,
        output=node.output if done else None,
        seconds=node.made_s if done and node.status != "fetched" else node.seconds,
        line=made.line if made else "",
        error=node.error,
        inputs=node.inputs,
        rule=rule.path,
        backend=rule.backend,
        result=made.digest if made else None,
        log=made.log if made else node.log,
        blocked_by=tuple(blockers),
        usage=node.usage,
        tries=node.tries,
        calls=node.calls or (made.called if made else ()),
    )


def status_of(node: Node) -> events.Status:
    """What a node came to, in the words of events."""
    if node.state is State.DONE:
        return "ran" if node.status == "ran" else "fetched" if node.status == "fetched" else "cached"
    if node.state is State.FAILED:
        return "failed"
    return "waits" if node.state is State.BLOCKED else "cancelled"


@dataclass(frozen=True)
class RunResult:
    """What became of a run."""

    ok: bool
    """Whether every target is up to date."""
    nodes: Mapping[str, NodeRecord]
    """Address -> record, in the order in which the run came to them."""
    targets: tuple[str, ...]
    """Addresses of the nodes that were asked for, every copy by itself."""
    run: str = ""
    """Id of the run."""
    wiring: Wiring | None = field(default=None, repr=False, compare=False)
    """What the run was made of."""
    errors: Mapping[str, DxbError] = field(default_factory=dict)
    """Address of a group, collection or target that failed without being a node -> why."""

    @property
    def own(self) -> Records:
        """Records of the nodes that the run looked at."""
        assert isinstance(self.nodes, Records)
        return self.nodes

    def rule(self, address: str) -> str:
        """The rule of a node; quicker than its whole record."""
        return self.nodes.rule(address) if isinstance(self.nodes, Records) else self.nodes[address].rule

    def output(self, address: str) -> str | None:
        """The output of a node; quicker than its whole record."""
        return self.nodes.output(address) if isinstance(self.nodes, Records) else self.nodes[address].output
