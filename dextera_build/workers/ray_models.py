"""Models that stay loaded on a Ray cluster: an actor for each, which serves the calls that use its weights.

Ray would give a call to any process, which then frees the model that it held, and would not count the memory of idle
ones. An actor keeps its GPU and memory reserved. It ends after a while without a call, and earlier if another call
would not fit next to it; the sums are those of the whole cluster, so a call that fits only on a node where idle actors
are left waits for their end.
"""

from __future__ import annotations

import time
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from dextera_build.workers.protocol import Task
from dextera_build.workers.ray_cluster import Amounts, RayCluster
from dextera_build.workers.ray_worker import Setup
from dextera_build.workers.warm import IDLE_S


@dataclass(eq=False)
class _Holder:
    actor: Any
    weights: tuple[str, ...]
    reserved: Amounts
    call: Any = None
    """The call that it answers; None: it is idle."""
    idle_since: float = 0.0


class Models:
    """The actors of one build.

    Args:
        cluster: Runs them.
    """

    def __init__(self, cluster: RayCluster) -> None:
        self._cluster = cluster
        self._holders: list[_Holder] = []

    def begin(self, setup: Setup, task: Task, reserved: Amounts) -> Any:
        """Queue a call on the idle actor that holds its weights, or on a new one."""
        holder = self._idle_for(task, reserved)
        if holder is None:
            holder = _Holder(self._cluster.hold(reserved), task.weights, reserved)
            self._holders.append(holder)
        holder.call = self._cluster.ask(holder.actor, setup, task)
        return holder.call

    def ended(self, call: Any, *, lost: bool) -> None:
        """Note the end of a call; a lost one may have lost its actor."""
        for holder in [holder for holder in self._holders if holder.call is call]:
            holder.call, holder.idle_since = None, time.monotonic()
            if lost:
                self._end(holder)

    def make_room(
        self, task: Task, reserved: Amounts, running: Collection[Amounts], nodes: Collection[Amounts]
    ) -> None:
        """End idle actors that leave no room for a call, the least recently used first.

        Args:
            task: The call.
            reserved: Its resources.
            running: Resources of the running calls.
            nodes: Total resources of each node.
        """
        if self._idle_for(task, reserved) is not None:
            return
        for holder in self._idle():
            wanted = [*running, reserved, *(other.reserved for other in self._idle())]
            if all(_sum(name, wanted) <= _sum(name, nodes) for name in ("GPU", "memory")):
                return
            self._end(holder)

    def end_stale(self) -> None:
        """End actors that nothing has used for a while."""
        for holder in self._idle():
            if time.monotonic() - holder.idle_since > IDLE_S:
                self._end(holder)

    def stop(self) -> None:
        """End all actors, also busy ones, whose calls Ray cannot interrupt."""
        for holder in list(self._holders):
            self._end(holder)

    def _idle_for(self, task: Task, reserved: Amounts) -> _Holder | None:
        """The idle actor that holds the weights of a call and reserves the resources for it."""
        return next((h for h in self._idle() if (h.weights, h.reserved) == (task.weights, reserved)), None)

    def _idle(self) -> list[_Holder]:
        return sorted((holder for holder in self._holders if holder.call is None), key=lambda holder: holder.idle_since)

    def _end(self, holder: _Holder) -> None:
        self._holders.remove(holder)
        self._cluster.end(holder.actor)


def _sum(name: str, amounts: Collection[Amounts]) -> float:
    return sum(each.get(name, 0.0) for each in amounts)
