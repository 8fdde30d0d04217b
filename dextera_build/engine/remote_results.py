"""Between the scheduler and remotes: fetches results instead of running nodes, and uploads new ones."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, TypeAlias

from dextera_build.engine.discovered import Reading
from dextera_build.engine.states import State
from dextera_build.engine.units import End, Node, States
from dextera_build.runs import events
from dextera_build.runs.events import Listener

if TYPE_CHECKING:
    # Not imported in builds without remotes.
    from dextera_build.remotes.exchange import Arrival, Exchange

Remotes: TypeAlias = "Exchange | None"
"""The remotes of a run; None if there are none."""
_TICK_S = 0.5
"""Interval between progress events of uploads [s]."""


class Sharing:
    """The remotes of one run.

    Args:
        exchange: Reads from and writes to remotes.
        states: The states of all units.
        reading: The discovered inputs of nodes.
        listen: Takes events about failing remotes and uploads.
    """

    def __init__(self, exchange: Remotes, states: States, reading: Reading, listen: Listener) -> None:
        self._exchange, self._states, self._reading, self._listen = exchange, states, reading, listen
        self._fetching: dict[str, Node] = {}
        self._missed: set[str] = set()
        self._arrived: list[Arrival] = []

    def ask(self, node: Node) -> bool:
        """Start looking for the node's result on remotes, with its bytes if needed; False if no remote can have it."""
        if self._exchange is None or not self._exchange.reads:
            return False
        if not node.rule.discovers:
            return self._ask(node, self._exchange)
        here = (node.key, node.document, node.reads)
        self._reading.begin(node)
        if self._ask(node, self._exchange):
            return True
        node.key, node.document, node.reads = here
        return False

    def _ask(self, node: Node, exchange: Exchange) -> bool:
        assert node.key is not None
        if node.key in self._missed:
            return False
        self._fetching[node.key] = node
        if node.state is not State.FETCHING:
            self._states.set(node, State.FETCHING)
        exchange.ask(node.key, whole=node.asked)
        return True

    def wait(self, patience_s: float) -> None:
        """Wait for an answer for at most `patience_s` [s]."""
        if self._exchange is not None:
            self._arrived += self._exchange.arrived(patience_s)

    def settle(self) -> Iterator[End]:
        """Yield the nodes whose answers arrived; those that no remote has must run."""
        self._tell()
        if not self._fetching:
            return
        self.wait(0.0)
        arrived, self._arrived = self._arrived, []
        for answer in arrived:
            node = self._fetching.pop(answer.key)
            if node.state is not State.FETCHING:
                continue
            if answer.result is None:
                self._missed.add(answer.key)
                yield self._without(node)
            else:
                node.remote, node.fetched_s = answer.remote, answer.seconds
                if not node.rule.discovers or node.reads is not None:
                    yield End(node, "fetched", answer.result, not answer.is_whole)
                elif not self._goes_on(node):
                    yield self._without(node)

    def _goes_on(self, node: Node) -> bool:
        """Request the result of a trace that a remote listed; False if no trace matches."""
        return self._exchange is not None and self._reading.follow(node) and self._ask(node, self._exchange)

    def _without(self, node: Node) -> End:
        """Handle a result that no remote has; a trace from a remote may still lead to a local one."""
        hit = self._reading.find(node) if node.rule.discovers else None
        if hit is not None and (hit.is_whole or not node.asked):
            return End(node, "cached", hit.result, not hit.is_whole)
        return End(node)

    def offer(self, node: Node) -> None:
        """Upload the node's result."""
        if self._exchange is not None and node.status == "ran" and node.key is not None:
            self._exchange.offer(node.key)

    def _tell(self) -> None:
        for notice in self._exchange.notices() if self._exchange else ():
            self._listen(events.RemoteGivenUp(time.time(), notice.remote, notice.address, notice.doing, notice.reason))

    def finish(self, pause: Callable[[], None]) -> None:
        """Wait for uploads and report their progress; `pause` is called before each wait."""
        if self._exchange is None:
            return
        pause()
        while left := self._exchange.wait(_TICK_S):
            total = self._exchange.offered
            self._tell()
            self._listen(events.Uploading(time.time(), total - left, total))
            pause()

    def close(self) -> None:
        """Close connections and report which uploads succeeded."""
        if self._exchange is None:
            return
        uploads = self._exchange.close()
        self._tell()
        for upload in uploads:
            left = len(upload.left)
            self._listen(
                events.Uploaded(time.time(), upload.remote, upload.results, upload.octets, left, upload.reason)
            )
