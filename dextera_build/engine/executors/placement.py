"""Where on a cluster a worker goes: what nodes have, what workers reserve, who makes room."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

T = TypeVar("T")

_GRAIN = 1e-6
"""Sums of fractions are compared with this slack."""


@dataclass(frozen=True)
class Shape:
    """What a worker reserves, by Ray's names: `CPU`, `GPU`, `memory` [bytes], or a resource that nodes declare."""

    amounts: tuple[tuple[str, float], ...]

    def fits(self, free: Mapping[str, float]) -> bool:
        """Whether there is so much."""
        return all(free.get(name, 0.0) + _GRAIN >= amount for name, amount in self.amounts)


@dataclass(frozen=True)
class Idle(Generic[T]):
    """A worker that has nothing to do, and could make room."""

    worker: T
    node: str
    shape: Shape


class Places:
    """What is free on each node, as far as this driver knows: other users of the cluster are Ray's to look after.

    Args:
        nodes: Node -> resource -> how much it has.
    """

    def __init__(self, nodes: Mapping[str, Mapping[str, float]]) -> None:
        self._whole: dict[str, dict[str, float]] = {}
        self._free: dict[str, dict[str, float]] = {}
        self.update(nodes)

    def update(self, nodes: Mapping[str, Mapping[str, float]]) -> None:
        """The cluster has these nodes now; what is reserved on those that stay remains so."""
        for node in [node for node in self._whole if node not in nodes]:
            del self._whole[node], self._free[node]
        for node, amounts in nodes.items():
            before = self._whole.get(node, {})
            free = self._free.setdefault(node, {})
            for name, amount in amounts.items():
                free[name] = free.get(name, 0.0) + amount - before.get(name, 0.0)
            self._whole[node] = dict(amounts)

    @property
    def nodes(self) -> Mapping[str, Mapping[str, float]]:
        """Node -> resource -> how much it has in all."""
        return self._whole

    def choose(self, shape: Shape, near: Mapping[str, int]) -> str | None:
        """A node with room for `shape`, or None: the one with most of `near`, then the one with most free cores."""
        fitting = [node for node, free in self._free.items() if shape.fits(free)]
        return max(fitting, key=lambda node: (near.get(node, 0), self._free[node].get("CPU", 0.0)), default=None)

    def make_room(self, shape: Shape, idle: Iterable[Idle[T]]) -> tuple[str, list[T]] | None:
        """The node where fewest idle workers must go so that `shape` fits, and these workers; None: nowhere.

        Args:
            shape: What needs room.
            idle: Workers, those that are missed least first.
        """
        found: tuple[str, list[T]] | None = None
        by_node: dict[str, list[Idle[T]]] = {}
        for each in idle:
            by_node.setdefault(each.node, []).append(each)
        for node, candidates in by_node.items():
            leave = self._leave(shape, node, candidates)
            if leave is not None and (found is None or len(leave) < len(found[1])):
                found = node, leave
        return found

    def take(self, node: str, shape: Shape) -> None:
        """A worker of this shape is on `node` now."""
        self._move(node, shape, -1.0)

    def give_back(self, node: str, shape: Shape) -> None:
        """A worker of this shape is there no more."""
        self._move(node, shape, 1.0)

    def _leave(self, shape: Shape, node: str, candidates: list[Idle[T]]) -> list[T] | None:
        free, leave = dict(self._free.get(node, {})), list[T]()
        for each in candidates:
            if shape.fits(free):
                break
            leave.append(each.worker)
            for name, amount in each.shape.amounts:
                free[name] = free.get(name, 0.0) + amount
        return leave if shape.fits(free) else None

    def _move(self, node: str, shape: Shape, sign: float) -> None:
        free = self._free.get(node)
        if free is not None:  # else the node is gone, and what was on it
            for name, amount in shape.amounts:
                free[name] = free.get(name, 0.0) + sign * amount
