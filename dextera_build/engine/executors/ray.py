"""Nodes on a Ray cluster: one actor is one place for a call, and only names and digests travel through Ray.

The scheduler decides what may start; here it is decided where. A worker reserves what the rule asks for and is kept for
the next call of the same shape. Workers of one model take calls of that model alone, so that its weights stay loaded,
and go last when others need room.
"""

from __future__ import annotations

import time
from collections import Counter, OrderedDict, defaultdict, deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Self, TypeAlias

from dextera_build.engine.capacity import Capacity, Needs
from dextera_build.engine.executors import shapes
from dextera_build.engine.executors.driver_store import DriverStore
from dextera_build.engine.executors.placement import Idle, Places, Shape
from dextera_build.engine.executors.ray_cluster import Cluster, Hand, Heard
from dextera_build.engine.executors.ray_worker import Setup, Word, read
from dextera_build.engine.tasks import Ended, Report, Said, Task
from dextera_build.errors import DxbError, MachineError
from dextera_build.store.store import Store

_TRIES = 3
"""How often a call is begun whose worker or node is lost."""
_LOOK_S = 2.0
"""How often the cluster is asked for its nodes while calls wait for room [s]."""
_GRACE_S = 1.5
_MOST_NEAR = 1 << 17
_KILLED = "9 (SIGKILL)"

Model: TypeAlias = str
"""What a worker keeps loaded; "" where it keeps nothing."""


@dataclass(eq=False)
class _Slot:
    """A worker and what it does."""

    hand: Hand
    node: str
    shape: Shape
    model: Model
    task: Task | None = None
    used: float = field(default_factory=time.monotonic)


class RayExecutor:
    """Workers on a cluster; use it as a context manager.

    Args:
        cluster: Where workers are hired; closed here.
        store: The driver's store. It is served to the workers under a password that lives as long as this does.
        setup: What workers are told, from the URL of that server.
        said: Amounts that the configuration names, over what the cluster has; see `shapes.capacity`.
        models: (rule, backend) -> what its workers keep loaded.
    """

    def __init__(
        self,
        cluster: Cluster,
        store: Store,
        setup: Setup,
        *,
        said: Mapping[str, float] | None = None,
        models: Mapping[tuple[str, str | None], Model] | None = None,
    ) -> None:
        self._cluster, self._said, self._models = cluster, said or {}, models or {}
        self._places = Places(cluster.nodes())
        self.capacity: Capacity = shapes.capacity(self._places.nodes, self._said)
        self._store = store
        self._offer = DriverStore(store, cluster.address)
        self._setup = self._offer.told(setup)
        self._slots: list[_Slot] = []
        self._idle: defaultdict[tuple[Shape, Model], list[_Slot]] = defaultdict(list)
        self._shapes: dict[Needs, Shape] = {}
        self._waiting: deque[Task] = deque()
        self._heard: SimpleQueue[tuple[_Slot, int, list[Word] | Exception]] = SimpleQueue()
        self._reports: list[Report] = []
        self._tries: Counter[int] = Counter()
        self._near: OrderedDict[str, str] = OrderedDict()
        """Artifact -> node whose store has it."""
        self._looked = time.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def submit(self, task: Task) -> None:
        """Give the task to a worker, or have it wait for room."""
        self._waiting.append(task)
        self._assign()

    def poll(self, timeout_s: float | None) -> list[Report]:
        """What workers said; a lost worker is no report, its call begins anew elsewhere."""
        end = time.monotonic() + timeout_s if timeout_s is not None else None
        while not self._reports:
            left = max(0.0, end - time.monotonic()) if end is not None else _LOOK_S
            try:
                self._hear(*self._heard.get(timeout=min(left, _LOOK_S)))
                while True:
                    self._hear(*self._heard.get_nowait())
            except Empty:
                if end is not None and time.monotonic() >= end:
                    break
            self._look()
        reports, self._reports = self._reports, []
        return reports

    def stop(self) -> None:
        """End all workers and what they run."""
        self._waiting.clear()
        busy = [slot for slot in self._slots if slot.task is not None]
        for slot in busy:
            slot.hand.stop()
        deadline = time.monotonic() + _GRACE_S
        while any(slot.task is not None for slot in busy) and (left := deadline - time.monotonic()) > 0:
            try:
                slot, _, _ = self._heard.get(timeout=left)
            except Empty:
                break
            slot.task = None
        for slot in list(self._slots):
            self._let_go(slot)
        self._reports.clear()

    def close(self) -> None:
        """End all workers, and let the cluster go."""
        if any(slot.task is not None for slot in self._slots):
            self.stop()
        for slot in list(self._slots):
            self._let_go(slot)
        self._offer.close()
        self._cluster.close()

    def _assign(self) -> None:
        """Begin the calls that there is room for, the eldest first."""
        for _ in range(len(self._waiting)):
            task = self._waiting.popleft()
            try:
                slot = self._slot(task)
            except DxbError as error:
                self._reports.append(Ended(task.ticket, 0.0, b"", error=error))
                continue
            if slot is None:
                self._waiting.append(task)
            else:
                self._begin(slot, task)

    def _slot(self, task: Task) -> _Slot | None:
        """A worker for the task: one that waits, or a new one, for which others may have to go."""
        shape = self._shapes.get(task.needs)
        if shape is None:
            gpu_memory_gb = self._said.get("gpu_memory", 0.0)
            shape = self._shapes[task.needs] = shapes.shape(task.needs, self._places.nodes.values(), gpu_memory_gb)
        model = self._models.get((task.rule, task.backend), "")
        near = Counter(node for digest in task.inputs.values() if (node := self._near.get(digest)) is not None)
        if fitting := self._idle.get((shape, model)):
            slot = max(fitting, key=lambda slot: (near.get(slot.node, 0), slot.used))
            fitting.remove(slot)
            return slot
        node = self._places.choose(shape, near) or self._make_room(shape)
        return self._hire(node, shape, model) if node is not None else None

    def _make_room(self, shape: Shape) -> str | None:
        """The node where `shape` has room once the workers are let go that are missed least, or None."""
        idle = [slot for waiting in self._idle.values() for slot in waiting]
        idle.sort(key=lambda slot: (bool(slot.model), slot.used))
        room = self._places.make_room(shape, (Idle(slot, slot.node, slot.shape) for slot in idle))
        if room is None:
            return None
        node, leave = room
        for slot in leave:
            self._let_go(slot)
        return node

    def _hire(self, node: str, shape: Shape, model: Model) -> _Slot:
        slot = _Slot(self._cluster.hire(self._setup, shape, node), node, shape, model)
        self._places.take(node, shape)
        self._slots.append(slot)
        return slot

    def _begin(self, slot: _Slot, task: Task) -> None:
        slot.task = task
        self._tries[task.ticket] += 1
        slot.hand.run(task, self._is_fresh(task), self._hearing(slot, task.ticket))

    def _is_fresh(self, task: Task) -> bool:
        """Whether nothing that an earlier build kept may be used.

        A folder here stands for those on the nodes: it is made with the first try and goes when the scheduler says so.
        """
        if not task.key:
            return True
        folder = self._store.keep.path(task.key)
        known = folder.is_dir()
        if not known:
            folder.mkdir(parents=True, exist_ok=True)
        return not known

    def _hearing(self, slot: _Slot, ticket: int) -> Heard:
        return lambda said: self._heard.put((slot, ticket, said))

    def _hear(self, slot: _Slot, ticket: int, said: list[Word] | Exception) -> None:
        if slot.task is None or slot.task.ticket != ticket:
            return  # it was stopped
        if isinstance(said, Exception):
            self._lost(slot, slot.task, said)
            return
        reports = [read(word, ticket) for word in said]
        if not any(isinstance(report, Ended) for report in reports):
            slot.hand.more(self._hearing(slot, ticket))
        for report in reports:
            if isinstance(report, Said):
                self._reports.append(report)
            else:
                self._end(slot, slot.task, report)

    def _end(self, slot: _Slot, task: Task, report: Ended) -> None:
        slot.task, slot.used = None, time.monotonic()
        self._idle[slot.shape, slot.model].append(slot)
        error = report.error
        if error is not None and error.facts.get("signal") == _KILLED and self._tries[task.ticket] < _TRIES:
            # On a cluster that is mostly somebody else's memory; what the call does wrong itself has another signal.
            self._again(task, "its process was killed")
        else:
            del self._tries[task.ticket]
            self._reports.append(report)
            if report.reply is not None:
                for digest in (*task.inputs.values(), report.reply["output"]):
                    self._near[digest] = slot.node
                while len(self._near) > _MOST_NEAR:
                    self._near.popitem(last=False)
        self._assign()

    def _lost(self, slot: _Slot, task: Task, error: Exception) -> None:
        slot.task = None
        self._let_go(slot)
        self._update()
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        if self._tries[task.ticket] < _TRIES:
            self._again(task, f"its worker was lost ({reason})")
        else:
            tries = self._tries.pop(task.ticket)
            self._reports.append(Ended(task.ticket, 0.0, b"", error=_gone(tries, reason)))
        self._assign()

    def _again(self, task: Task, why: str) -> None:
        self._waiting.appendleft(task)
        self._reports.append(Said(task.ticket, "log", {"text": f"{why}, it begins anew"}))

    def _let_go(self, slot: _Slot) -> None:
        slot.hand.kill()
        self._slots.remove(slot)
        idle = self._idle[slot.shape, slot.model]
        if slot in idle:
            idle.remove(slot)
        self._places.give_back(slot.node, slot.shape)

    def _look(self) -> None:
        """Where calls wait for room, see whether there is some now."""
        if self._waiting and time.monotonic() >= self._looked + _LOOK_S:
            self._update()
            self._assign()

    def _update(self) -> None:
        self._looked = time.monotonic()
        self._places.update(self._cluster.nodes())
        self._shapes.clear()


def _gone(tries: int, reason: str) -> MachineError:
    return MachineError(
        f"its worker was lost {tries} times",
        code="DXB-E354",
        facts={"ray says": reason},
        hint="`ray status` shows which nodes are left; build again",
    )
