"""What became of the nodes of a run."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import field
from itertools import chain
from typing import Any

from dextera_build.engine import events
from dextera_build.engine.known import Known
from dextera_build.engine.wiring import Wiring
from dextera_build.errors import DxbError
from dextera_build.plain import dataclass
from dextera_build.store.actions import Actions
from dextera_build.store.cas import MissingBlob
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


class Kept(Mapping[str, NodeRecord]):
    """Records of the nodes that a run looked at, and of those that it knew from before, read when asked for.

    Args:
        own: Those that it looked at.
        known: What was known.
        store: Has the rest.
    """

    def __init__(self, own: Mapping[str, NodeRecord], known: Known, store: Store) -> None:
        self.own = own
        self._known = known
        self._blobs = store.blobs
        # One of its own: what is only told of must not be noted as what the build found.
        self._actions = Actions(store.actions.root, store.blobs, store.recent)

    def rule(self, address: str) -> str:
        """The rule of a node."""
        return self.own[address].rule if address in self.own else self._known.rule(address).path

    def output(self, address: str) -> str | None:
        """The output of a node."""
        return self.own[address].output if address in self.own else self._known.output(address)

    def __getitem__(self, address: str) -> NodeRecord:
        if address in self.own:
            return self.own[address]
        key, output = self._known.key(address), self._known.output(address)
        if key is None or output is None:
            raise KeyError(address)
        rule = self._known.rule(address)
        result = self._actions.known(key)
        return NodeRecord(
            status="cached",
            key=key,
            output=output,
            seconds=self._known.took(address) or 0.0,
            line=result.line if result else "",
            error=None,
            inputs=self._inputs(result.key_document) if result else {},
            rule=rule.path,
            backend=rule.backend,
            result=result.digest if result else None,
            log=result.log if result else None,
            calls=result.called if result else (),
        )

    def __iter__(self) -> Iterator[str]:
        fresh = (address for address in self.own if self._known.names.find(address) is None)
        return chain(self._known.addresses(), fresh)

    def __len__(self) -> int:
        return len(self._known.seconds) + sum(self._known.names.find(address) is None for address in self.own)

    def _inputs(self, document: str) -> dict[str, str]:
        try:
            return dict(json.loads(self._blobs.get(document))["inputs"])
        except MissingBlob:
            return {}


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
    peak_gb: Callable[[str], float | None] = field(default=lambda address: None, repr=False, compare=False)
    """Memory that a node took the last time that it ran [GiB], where that is known."""

    @property
    def own(self) -> Mapping[str, NodeRecord]:
        """Records of the nodes that the run looked at."""
        return self.nodes.own if isinstance(self.nodes, Kept) else self.nodes

    def rule(self, address: str) -> str:
        """The rule of a node; quicker than its whole record."""
        return self.nodes.rule(address) if isinstance(self.nodes, Kept) else self.nodes[address].rule

    def output(self, address: str) -> str | None:
        """The output of a node; quicker than its whole record."""
        return self.nodes.output(address) if isinstance(self.nodes, Kept) else self.nodes[address].output
