"""Nodes on a Ray cluster: the scheduler decides what may start, Ray decides where.

A call is a Ray task that reserves what its rule asks for. Calls whose backend names weights go to actors instead, one
model each, so that the weights stay loaded; an idle actor ends when another call waits for a place.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Self, TypeAlias

from dextera_build.errors import DxbError, MachineError
from dextera_build.remotes.connect import open_remote
from dextera_build.store.store import Store
from dextera_build.workers import shapes
from dextera_build.workers.capacity import Capacity
from dextera_build.workers.protocol import Ended, Report, Said, Task
from dextera_build.workers.ray_cluster import RayCluster
from dextera_build.workers.ray_worker import BEGAN, Setup, Word, read
from dextera_build.workers.shapes import Shape
from dextera_build.workers.staging import Staging

_TRIES = 3
"""How often a call is begun whose worker or node is lost."""
_LOOK_S = 2.0
"""How often the cluster is asked for its nodes while calls wait for a place [s]."""
_GRACE_S = 1.5
_KILLED = "9 (SIGKILL)"

Model: TypeAlias = str
"""What an actor keeps loaded."""


@dataclass
class _Call:
    """A task that was handed to Ray."""

    task: Task
    shape: Shape
    actor: Any = None
    queued: float = field(default_factory=time.monotonic)
    began: bool = False


class RayExecutor:
    """Calls on a cluster; use it as a context manager.

    Args:
        cluster: Where calls run; closed here.
        store: The driver's store.
        setup: What workers are told.
        said: Amounts that the configuration names, over what the cluster has; see `shapes.capacity`.
        models: (rule, backend) -> what its workers keep loaded.
        discovering: Rules that read files of the project by themselves, which no other machine has.
    """

    def __init__(
        self,
        cluster: RayCluster,
        store: Store,
        setup: Setup,
        *,
        said: Mapping[str, float] | None = None,
        models: Mapping[tuple[str, str | None], Model] | None = None,
        discovering: Collection[str] = (),
    ) -> None:
        self._cluster, self._store, self._setup = cluster, store, setup
        self._said, self._models, self._discovering = said or {}, models or {}, discovering
        self._nodes = cluster.nodes()
        self.capacity: Capacity = shapes.capacity(self._nodes, self._said)
        self._staging = Staging(store, open_remote(setup.shared))
        self._calls: dict[Any, _Call] = {}
        """By what Ray knows them as."""
        self._idle: list[tuple[Model, Shape, Any]] = []
        """ModelActors without a call."""
        self._tries: dict[int, int] = {}
        self._reports: list[Report] = []
        self._looked = time.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def submit(self, task: Task) -> None:
        """Upload what the call reads, and queue it."""
        try:
            if task.rule in self._discovering:
                raise _reads_the_project(task.rule)
            self._staging.send(task.inputs.values())
            self._begin(task)
        except DxbError as error:
            self._reports.append(Ended(task.ticket, 0.0, b"", error=error))

    def poll(self, timeout_s: float | None) -> list[Report]:
        """What calls said; a lost worker is no report, its call begins anew elsewhere."""
        end = time.monotonic() + timeout_s if timeout_s is not None else None
        while not self._reports and self._calls:
            left = max(0.0, end - time.monotonic()) if end is not None else _LOOK_S
            for handle, word in self._cluster.hear(self._calls, min(left, _LOOK_S)):
                self._hear(handle, word)
            if time.monotonic() >= self._looked + _LOOK_S:
                self._look()
            if end is not None and time.monotonic() >= end:
                break
        reports, self._reports = self._reports, []
        return reports

    def stop(self) -> None:
        """End all calls and what they run."""
        for handle, call in self._calls.items():
            if call.actor is None:
                self._cluster.cancel(handle)
            else:
                self._cluster.dismiss(call.actor)
        deadline = time.monotonic() + _GRACE_S
        while self._calls and (left := deadline - time.monotonic()) > 0:
            for handle, word in self._cluster.hear(self._calls, left):
                if isinstance(word, Exception):
                    del self._calls[handle]
        self._calls.clear()
        self._reports.clear()

    def close(self) -> None:
        """End what is left, and let the cluster go."""
        if self._calls:
            self.stop()
        self._cluster.close()

    def _begin(self, task: Task) -> None:
        shape = shapes.shape(task.needs, self._nodes.values(), self._said.get("gpu_memory", 0.0))
        model = self._models.get((task.rule, task.backend))
        call = _Call(task, shape)
        if model is not None:
            idle = next((each for each in self._idle if each[:2] == (model, shape)), None)
            if idle is not None:
                self._idle.remove(idle)
            call.actor = idle[2] if idle is not None else self._cluster.actor(shape)
        self._tries[task.ticket] = self._tries.get(task.ticket, 0) + 1
        self._calls[self._cluster.begin(self._setup, task, self._is_fresh(task), call.actor or shape)] = call

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

    def _hear(self, handle: Any, word: Word | Exception) -> None:
        call = self._calls[handle]
        if isinstance(word, Exception):
            del self._calls[handle]
            self._lost(call, word)
        elif word == BEGAN:
            call.began = True
        else:
            report = read(word, call.task.ticket)
            if isinstance(report, Said):
                self._reports.append(report)
            else:
                del self._calls[handle]
                self._end(call, report)

    def _end(self, call: _Call, report: Ended) -> None:
        task, error = call.task, report.error
        if call.actor is not None:
            self._idle.append((self._models[task.rule, task.backend], call.shape, call.actor))
        if error is not None and error.facts.get("signal") == _KILLED and self._tries[task.ticket] < _TRIES:
            # On a cluster that is mostly somebody else's memory; what the call does wrong itself has another signal.
            self._again(task, "its process was killed")
            return
        del self._tries[task.ticket]
        if report.reply is not None:
            try:
                self._staging.bring_made(report.reply)
            except DxbError as failure:
                report = Ended(report.ticket, report.seconds, report.log, error=failure, usage=report.usage)
        self._reports.append(report)

    def _lost(self, call: _Call, error: Exception) -> None:
        if call.actor is not None:
            self._cluster.dismiss(call.actor)
        error = getattr(error, "cause", None) or error  # else Ray's text begins with where it came from
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        ticket = call.task.ticket
        self._update()
        if self._tries[ticket] < _TRIES:
            self._again(call.task, f"its worker was lost ({reason})")
        else:
            self._reports.append(Ended(ticket, 0.0, b"", error=_gone(self._tries.pop(ticket), reason)))

    def _again(self, task: Task, why: str) -> None:
        self._reports.append(Said(task.ticket, "log", {"text": f"{why}, it starts again"}))
        self.submit(task)

    def _look(self) -> None:
        """See to calls that wait for a place: idle actors make room, and no call waits for a machine that is gone."""
        waiting = {handle: call for handle, call in self._calls.items() if not call.began}
        if any(time.monotonic() >= call.queued + _LOOK_S for call in waiting.values()):
            for _, _, actor in self._idle:
                self._cluster.dismiss(actor)
            self._idle.clear()
        self._update()
        for handle, call in waiting.items():
            if not any(shapes.fits(call.shape, node) for node in self._nodes.values()):
                del self._calls[handle]
                self._cluster.cancel(handle)
                self._lost(call, ConnectionError("no machine is left that has room for it"))

    def _update(self) -> None:
        self._looked = time.monotonic()
        self._nodes = self._cluster.nodes()


def _reads_the_project(rule: str) -> MachineError:
    return MachineError(
        f"`{rule}` reads files of the project by itself, which other machines do not have",
        code="DXB-E370",
        hint="build its nodes with `--executor local` first; the cluster then takes their results",
    )


def _gone(tries: int, reason: str) -> MachineError:
    return MachineError(
        f"its worker was lost {tries} times",
        code="DXB-E354",
        facts={"ray says": reason},
        hint="`ray status` shows which nodes are left; build again",
    )
