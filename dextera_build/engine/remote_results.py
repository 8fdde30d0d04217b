"""Between the scheduler and remotes: nodes that are fetched rather than run, and results that are uploaded."""

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
    # A build without remotes need not wait for these.
    from dextera_build.remotes.exchange import Arrival, Exchange

Remotes: TypeAlias = "Exchange | None"
"""The remotes of a run; None if there are none."""
_TICK_S = 0.5
"""How often it is said how far uploads are [s]."""


class Sharing:
    """The remotes of one run.

    Args:
        exchange: Asks and tells remotes.
        states: The states of all units.
        reading: Knows the discovered inputs of nodes.
        listen: Is told of remotes that are given up, and of uploads.
    """

    def __init__(self, exchange: Remotes, states: States, reading: Reading, listen: Listener) -> None:
        self._exchange, self._states, self._reading, self._listen = exchange, states, reading, listen
        self._fetching: dict[str, Node] = {}
        self._missed: set[str] = set()
        self._arrived: list[Arrival] = []

    def ask(self, node: Node) -> bool:
        """Look for the node's result elsewhere, with its bytes where these are asked for; False where no one has it."""
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
        """Let time pass until an answer comes, at most so long [s]."""
        if self._exchange is not None:
            self._arrived += self._exchange.arrived(patience_s)

    def settle(self) -> Iterator[End]:
        """Go on with the nodes whose answers came; those that no remote has are to run."""
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
        """Whether one of the traces that a remote listed fits; then its result is asked for."""
        return self._exchange is not None and self._reading.follow(node) and self._ask(node, self._exchange)

    def _without(self, node: Node) -> End:
        """No remote has the result; a trace that came from one may lead to a local one."""
        hit = self._reading.find(node) if node.rule.discovers else None
        if hit is not None and (hit.is_whole or not node.asked):
            return End(node, "cached", hit.result, not hit.is_whole)
        return End(node)

    def offer(self, node: Node) -> None:
        """Upload what the node made."""
        if self._exchange is not None and node.status == "ran" and node.key is not None:
            self._exchange.offer(node.key)

    def _tell(self) -> None:
        for notice in self._exchange.notices() if self._exchange else ():
            self._listen(events.RemoteGivenUp(time.time(), notice.remote, notice.address, notice.doing, notice.reason))

    def finish(self, pause: Callable[[], None]) -> None:
        """Wait for uploads, and say how far they are; `pause` is called before time passes."""
        if self._exchange is None:
            return
        pause()
        while left := self._exchange.wait(_TICK_S):
            total = self._exchange.offered
            self._tell()
            self._listen(events.Uploading(time.time(), total - left, total))
            pause()

    def close(self) -> None:
        """Let connections go, and say what was uploaded and what was not."""
        if self._exchange is None:
            return
        uploads = self._exchange.close()
        self._tell()
        for upload in uploads:
            left = len(upload.left)
            self._listen(
                events.Uploaded(time.time(), upload.remote, upload.results, upload.octets, left, upload.reason)
            )
