"""Short nodes stand behind one another at a worker, so that it need not wait for the scheduler between two of them.

A seat is what one node was admitted with: the node that has it, and those that will have it one after the other. Only
nodes of rules that have shown themselves to be short in this run stand behind one, and only behind such. Where one
takes long all the same, those behind it are taken back.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, field

from dextera_build.engine.graph import RuleFacts
from dextera_build.engine.units import Node

LONG_S = 0.02
"""A node that takes longer [s] has nobody stand behind it."""
_MOST = 24
"""So many nodes have a seat or stand behind at most."""
_MOST_S = 0.01
"""So long do they take together by what is known of their rules [s], so that no one waits long for his turn."""
_SEEN = 4
"""After so many runs of a rule it is known how long it takes."""
_MEMORY = 16
"""An average goes over about so many runs."""
_UNKNOWN_S = 1e6
_NAP_S = 0.001
_LEAST_NAP_S = 0.0002


class Pace:
    """How long the calls of each rule take in this run.

    Args:
        took: How long a node took the last time [s], where that is known; until more is known of its rule the least of
            these counts, since others may have waited for a worker to load the rule.
    """

    def __init__(self, took: Callable[[str], float | None] = lambda address: None) -> None:
        self._known: dict[tuple[str, str | None], tuple[int, float]] = {}
        self._took = took
        self._least: dict[tuple[str, str | None], float] = {}

    def note(self, rule: RuleFacts, seconds: float) -> None:
        """A call took so long [s]."""
        count, mean = self._known.get((rule.path, rule.backend), (-1, 0.0))
        count += 1
        if count:  # in the first its worker loads the rule
            mean += (seconds - mean) / min(count, _MEMORY)
        self._known[rule.path, rule.backend] = (count, mean)

    def expected_s(self, node: Node) -> float:
        """How long a call will take [s]; very long where that is not known."""
        rule = (node.rule.path, node.rule.backend)
        count, mean = self._known.get(rule, (0, 0.0))
        if count >= _SEEN:
            return mean
        took = self._took(node.address)
        least = self._least[rule] = min(self._least.get(rule, _UNKNOWN_S), _UNKNOWN_S if took is None else took)
        return least


@dataclass(eq=False, slots=True)
class Seat:
    """Nodes that run one after another at one worker; the first runs."""

    nodes: deque[tuple[Node, float]]
    """With how long each is expected to take [s]."""
    left_s: float
    """How long they take together [s]."""
    began: float = field(default_factory=time.monotonic)
    """When the first began, as far as that is known here."""
    is_told: bool = True
    """Whether it was said that the first began."""
    is_late: bool = False
    """Whether the first takes long, so that none may stand behind it."""

    @property
    def first(self) -> Node:
        """The node that runs."""
        return self.nodes[0][0]

    def fits(self, expected_s: float) -> bool:
        """Whether one that takes so long may stand behind."""
        return not self.is_late and len(self.nodes) < _MOST and self.left_s + expected_s <= _MOST_S

    @property
    def room(self) -> tuple[int, float]:
        """How many more nodes may stand behind, and how long these may take together [s]."""
        return (0, 0.0) if self.is_late else (_MOST - len(self.nodes), _MOST_S - self.left_s)

    def add(self, node: Node, expected_s: float) -> None:
        """Have a node stand behind all others."""
        self.nodes.append((node, expected_s))
        self.left_s += expected_s

    def drop(self, nodes: Collection[Node]) -> None:
        """These stand there no more; if the first is among them, another has begun."""
        first = self.first
        self.nodes = deque(pair for pair in self.nodes if pair[0] not in nodes)
        self.left_s = sum(expected_s for _, expected_s in self.nodes)
        if self.first is not first:
            self.began, self.is_told = time.monotonic(), False

    def advance(self) -> None:
        """The first has ended."""
        self.left_s -= self.nodes.popleft()[1]
        self.began, self.is_told, self.is_late = time.monotonic(), False, False


def nap_s(seats: Iterable[Seat]) -> float:
    """How long nobody need look after these [s], since all of them have something to do meanwhile."""
    least = min((seat.left_s - seat.nodes[0][1] for seat in seats), default=0.0) / 2
    return min(least, _NAP_S) if least >= _LEAST_NAP_S else 0.0
