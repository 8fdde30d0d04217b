"""Admission control: chooses the next task to start, within the machine's resources and without starvation.

Tasks with equal needs share one FIFO queue, so only the head of each queue is examined, however many tasks wait. The
oldest head that fits starts. A task that does not fit may be overtaken by younger ones a few times; then it gets a
reservation: from then on a younger task starts only if both fit side by side. The older task thus starts at the latest
when all tasks running at that moment have ended.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from dextera_build.errors import MachineError
from dextera_build.workers.capacity import Capacity, Needs

T = TypeVar("T", bound=Hashable)

_PASSES = 8
"""How often a task that does not fit is overtaken before it gets a reservation."""
_UNITS = 1000
"""Amounts are integers in thousandths, which avoids rounding errors in sums."""
_MARGIN = 1.25
_MARGIN_GB = 0.0625


@dataclass(frozen=True)
class Grant:
    """Resources granted to a task."""

    amounts: tuple[tuple[str, int], ...]
    devices: tuple[tuple[int, int], ...] = ()
    """(device, amount of its memory)."""


class Ledger:
    """Free resources.

    Args:
        capacity: All resources.
    """

    def __init__(self, capacity: Capacity) -> None:
        self._whole = {"cpu": capacity.cpus * _UNITS, "memory": _count(capacity.memory_gb)}
        self._whole |= {name: _count(amount) for name, amount in capacity.named.items()}
        self._free = dict(self._whole)
        self._sizes = [max(_count(gpu.memory_gb), 1) for gpu in capacity.gpus]
        self._left = list(self._sizes)

    def place(self, needs: Needs) -> Grant | None:
        """The grant for `needs`, or None if they do not fit now; excess cores or memory are clamped to the capacity."""
        grant = Grant(self._amounts(needs))
        for name, amount in grant.amounts:
            if self._free[name] < amount:
                return None
        devices = self._devices(needs)
        if not devices:
            return None if devices is None else grant
        return Grant(grant.amounts, devices)

    def move(self, grant: Grant, sign: int) -> None:
        """Take granted resources (`sign` -1) or return them (`sign` 1)."""
        for name, amount in grant.amounts:
            self._free[name] += sign * amount
        for device, amount in grant.devices:
            self._left[device] += sign * amount

    def _amounts(self, needs: Needs) -> tuple[tuple[str, int], ...]:
        wanted = {"cpu": max(needs.cpus, 1) * _UNITS, "memory": _count(needs.memory_gb)}
        if any(wanted[name] > self._whole[name] for name in wanted):
            # Every task takes a core, so a task with all cores runs alone.
            wanted = {"cpu": self._whole["cpu"], "memory": min(wanted["memory"], self._whole["memory"])}
        return (*wanted.items(), *((name, _count(amount)) for name, amount in needs.named))

    def _devices(self, needs: Needs) -> tuple[tuple[int, int], ...] | None:
        if not needs.gpus and not needs.gpu_gb:
            return ()
        count = max(needs.gpus, 1)
        least = min(_count(needs.gpu_gb), sorted(self._sizes, reverse=True)[count - 1])
        if needs.gpus:
            fit = [n for n, size in enumerate(self._sizes) if self._left[n] == size >= least]
            return tuple((n, self._sizes[n]) for n in fit[:count]) if len(fit) >= count else None
        rooms = [(left, n) for n, left in enumerate(self._left) if left >= least]
        return ((min(rooms)[1], least),) if rooms else None


@dataclass(slots=True)
class _Line(Generic[T]):
    """Queue of tasks with equal needs and their order among all tasks, oldest first."""

    needs: Needs
    waiting: deque[tuple[int, T]] = field(default_factory=deque)
    passed: int = 0
    """How often younger tasks of other queues overtook its head."""

    @property
    def place(self) -> int:
        """Order of its head."""
        return self.waiting[0][0]


class Admission(Generic[T]):
    """The waiting and running tasks of one run.

    Args:
        capacity: Resources that they share.
        passes: How often a task that does not fit may be overtaken.
    """

    def __init__(self, capacity: Capacity, passes: int = _PASSES) -> None:
        self.capacity = capacity
        self._passes = passes
        self._ledger = Ledger(capacity)
        self._lines: dict[Needs, _Line[T]] = {}
        self._running: dict[T, Grant] = {}
        self._order = itertools.count()
        self._reserved = -1
        self._passers: set[T] = set()

    def wait(self, task: T, needs: Needs) -> None:
        """Add a waiting task; its `needs` must be within the capacity."""
        line = self._lines.setdefault(needs, _Line(needs))
        line.waiting.append((next(self._order), task))

    def next(self) -> T | None:
        """Take the next task and reserve its resources; None if no task fits."""
        reserved: _Line[T] | None = None
        for line in sorted(self._lines.values(), key=lambda line: line.place):
            grant = self._ledger.place(line.needs)
            if grant is None:
                if reserved is None and line.passed >= self._passes:
                    reserved = line
                    if self._reserved != line.place:
                        self._reserved = line.place
                        self._passers.clear()
            elif reserved is None or self._fit_together(reserved.needs, grant):
                return self._start(line, grant, passes=reserved is not None)
        return None

    def end(self, task: T) -> None:
        """Release the resources of `task`."""
        self._ledger.move(self._running.pop(task), 1)
        self._passers.discard(task)

    def devices(self, task: T) -> tuple[str, ...]:
        """Ids of the devices granted to a running task."""
        return tuple(self.capacity.gpus[device].id for device, _ in self._running[task].devices)

    def _start(self, line: _Line[T], grant: Grant, passes: bool) -> T:
        place, task = line.waiting.popleft()
        line.passed = 0
        if not line.waiting:
            del self._lines[line.needs]
        for other in self._lines.values():
            other.passed += other.place < place
        self._ledger.move(grant, -1)
        self._running[task] = grant
        if passes:
            self._passers.add(task)
        return task

    def _fit_together(self, elder: Needs, grant: Grant) -> bool:
        """Whether `elder` fits alongside the tasks that overtook it and `grant`."""
        ledger = Ledger(self.capacity)
        for passer in self._passers:
            ledger.move(self._running[passer], -1)
        ledger.move(grant, -1)
        return ledger.place(elder) is not None


def estimate(declared: Needs, peak_gb: float | None) -> Needs:
    """The needs used for admission: the last measured peak memory plus a margin, or the declared needs if unknown.

    The memory is rounded up to a step of about a fifth, so that tasks of one rule fall into few queues.
    """
    if peak_gb is None:
        return declared
    wanted = peak_gb * _MARGIN + _MARGIN_GB
    step = max(2.0 ** (math.floor(math.log2(wanted)) - 2), _MARGIN_GB)
    memory = math.ceil(wanted / step) * step
    return Needs(declared.cpus, memory, declared.gpus, declared.gpu_gb, declared.named)


def lacks(found: Mapping[str, tuple[float, float]]) -> MachineError:
    """The error of a node that needs more than the machine has; see `Needs.lacks`."""
    said = ", ".join(f"{wanted:g} of `{name}`" for name, (wanted, _) in found.items())
    name, (wanted, _) = next(iter(found.items()))
    return MachineError(
        f"it needs {said}, which is more than there is",
        code="DXB-E345",
        facts={f"`{name}` here": f"{there:g}" for name, (_, there) in found.items()},
        hint=f"set the amount, `--resources {name}={wanted:g}` or `[resources]` in dxb.toml, choose another backend, "
        "or add a machine to the cluster",
    )


def _count(amount: float) -> int:
    return round(amount * _UNITS)
