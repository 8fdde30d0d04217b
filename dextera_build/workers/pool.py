"""A pool of worker processes on this machine."""

from __future__ import annotations

import math
import selectors
import time
from collections.abc import Mapping
from types import TracebackType
from typing import Self

from dextera_build.errors import MachineError, from_json
from dextera_build.workers.capacity import Capacity
from dextera_build.workers.process import Process
from dextera_build.workers.protocol import Ended, Report, Said, Task

_GRACE_S = 1.0
_LOOK_S = 0.25


class LocalExecutor:
    """Workers that are started when needed and kept; use it as a context manager.

    Workers end with the thread that started them (that is how Linux tells them that their parent died), so build from
    a thread that outlives the build.

    Args:
        runner: `module:function` that carries out a task in a worker.
        capacity: What tasks share.
        environment: Variables that workers see beside those of this process.
    """

    def __init__(self, runner: str, capacity: Capacity, environment: Mapping[str, str] | None = None) -> None:
        self.capacity = capacity
        self._runner = runner
        self._environment = dict(environment or {})
        self._selector = selectors.DefaultSelector()
        self._workers: list[Process] = []
        self._waiting: list[Task] = []
        """Tasks that found no idle worker: one is loading for each, but the first that is free takes it."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def warm(self) -> None:
        """Start a worker, which loads what it needs while it is not known yet what it will run."""
        self._start(())

    def submit(self, task: Task) -> None:
        """Hand the task to an idle worker, or to the next one that is free: it may take long to load another."""
        process = self._idle(task.devices)
        if process is not None:
            process.give(task)
            return
        loading = sum(other.devices == task.devices and not other.is_ready for other in self._workers)
        if loading <= sum(other.devices == task.devices for other in self._waiting):
            self._start(task.devices)
        self._waiting.append(task)

    def poll(self, timeout_s: float | None) -> list[Report]:
        """What workers reported; a worker that died is reported as the failure of its node."""
        reports: list[Report] = []
        patience = timeout_s if timeout_s is not None else math.inf
        # A dead worker need not show in its socket: something that it started may hold the other end.
        patience = min(patience, _LOOK_S) if self._busy() else patience
        for key, _ in self._selector.select(patience if patience < math.inf else None):
            reports += self._hear(key.data)
        for process in [process for process in self._busy() if process.has_ended]:
            reports += self._hear(process)
        return reports

    def stop(self) -> None:
        """End all workers and everything that they started; those that run may clean up."""
        for process in self._busy():
            process.ask_to_end()
        deadline = time.monotonic() + _GRACE_S
        while self._workers:
            process = self._workers[0]
            self._end(process, max(0.0, deadline - time.monotonic()) if process.task else 0.0)
        self._waiting.clear()

    def pids(self) -> list[int]:
        """Process ids of all workers."""
        return [process.pid for process in self._workers]

    def _busy(self) -> list[Process]:
        return [process for process in self._workers if process.task is not None]

    def _idle(self, devices: tuple[str, ...]) -> Process | None:
        """An idle worker with these devices."""
        for process in [process for process in self._workers if process.is_ready and process.task is None]:
            if process.devices != devices and set(process.devices).isdisjoint(devices):
                continue
            if process.devices == devices and not process.has_ended:
                return process
            # Dead, or it holds memory of a device that another worker needs now.
            self._end(process, 0.0)
        return None

    def _start(self, devices: tuple[str, ...]) -> None:
        try:
            process = Process(self._runner, self._environment, devices)
        except OSError as error:
            raise MachineError(
                "a worker process cannot be started",
                code="DXB-E202",
                facts={"system says": error.strerror, "workers": len(self._busy())},
                hint="build with `--jobs 1`",
            ) from None
        self._selector.register(process.descriptor, selectors.EVENT_READ, process)
        self._workers.append(process)

    def _hear(self, process: Process) -> list[Report]:
        lines, ended = process.hear()
        reports: list[Report] = []
        for line in lines:
            if "ready" in line:
                process.is_ready = True
            elif process.task is None:  # something that a task left behind goes on talking
                continue
            elif "said" in line:
                kind, data = line["said"]
                reports.append(Said(process.task.ticket, kind, data))
            else:
                log, error = line["log"].encode("latin-1"), from_json(line["error"]) if line["error"] else None
                reports.append(Ended(**{**line, "ticket": process.task.ticket, "log": log, "error": error}))
                process.task = None
        if ended:
            reports += self._bury(process)
        elif process.is_ready and process.task is None and (task := self._next(process.devices)) is not None:
            process.give(task)
        return reports

    def _next(self, devices: tuple[str, ...]) -> Task | None:
        """Take the first task that waits for a worker with these devices."""
        task = next((task for task in self._waiting if task.devices == devices), None)
        if task is not None:
            self._waiting.remove(task)
        return task

    def _bury(self, process: Process) -> list[Report]:
        """A worker is dead: the task that it had, or that it was loading for, has failed."""
        self._end(process, _GRACE_S)
        task = process.task if process.is_ready else self._next(process.devices)
        if task is None:
            return []
        seconds, log = time.monotonic() - process.began, process.log()
        return [Ended(task.ticket, seconds, log, error=process.death(log), usage={"memory_bytes": process.peak})]

    def _end(self, process: Process, patience_s: float) -> None:
        self._workers.remove(process)
        self._selector.unregister(process.descriptor)
        process.end(patience_s)
