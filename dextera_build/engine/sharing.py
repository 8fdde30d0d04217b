"""Between the scheduler and remotes: nodes that are fetched rather than run, and results that are uploaded."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from dextera_build.engine.states import State, States
from dextera_build.engine.units import Node
from dextera_build.store.actions import ActionResult
from dextera_build.store.remotes.exchange import Arrival, Exchange
from dextera_build.store.remotes.remote import Digest


class Succeed(Protocol):
    """Ends a node with a result."""

    def __call__(self, node: Node, status: str, result: ActionResult, *, bare: bool = False) -> None:
        """`bare`: bytes of the result may be absent."""


class Sharing:
    """The remotes of one run.

    Args:
        exchange: Asks and tells remotes; None where there are none.
        states: The states of all units.
        succeed: Ends a node with a result.
        queue: Lets a node run that no remote has.
    """

    def __init__(
        self,
        exchange: Exchange | None,
        states: States,
        succeed: Succeed,
        queue: Callable[[Node], None],
    ) -> None:
        self._exchange, self._states, self._succeed, self._queue = exchange, states, succeed, queue
        self._fetching: dict[str, Node] = {}
        self._missed: set[str] = set()
        self._arrived: list[Arrival] = []

    def ask(self, node: Node) -> bool:
        """Look for the node's result elsewhere, with its bytes where these are asked for; False where no one has it."""
        if self._exchange is None or not self._exchange.reads:
            return False
        assert node.key is not None
        if node.key in self._missed:
            return False
        self._fetching[node.key] = node
        self._states.set(node, State.FETCHING)
        self._exchange.ask(Digest(node.key, len(node.document)), whole=node.asked)
        return True

    def wait(self, patience_s: float) -> None:
        """Let time pass until an answer comes, at most so long [s]."""
        if self._exchange is not None:
            self._arrived += self._exchange.arrived(patience_s)

    def settle(self) -> None:
        """Go on with the nodes whose answers came: those that no remote has are to run."""
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
                self._queue(node)
            else:
                node.remote, node.seconds = answer.remote, answer.seconds
                self._succeed(node, "fetched", answer.result, bare=not answer.is_whole)

    def offer(self, node: Node) -> None:
        """Upload what the node made."""
        if self._exchange is not None and node.status == "ran" and node.key is not None:
            self._exchange.offer(node.key)
