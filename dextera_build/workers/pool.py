"""A pool of worker processes on this machine."""

from __future__ import annotations

import os
import selectors
import time
from collections.abc import Mapping
from types import TracebackType
from typing import Any, Self

from dextera_build.errors import MachineError, from_json
from dextera_build.workers.capacity import Capacity, available_gb
from dextera_build.workers.process import Process, Sampler
from dextera_build.workers.protocol import Ended, Report, Said, Task
from dextera_build.workers.usage import with_peak

_GRACE_S = 1.0


class LocalExecutor:
    """Workers that are started when needed and kept; use it as a context manager.

    Workers end with the thread that started them (that is how Linux tells them that their parent died), so build from
    a thread that outlives the build.

    Args:
        runner: `module:function` that carries out a task in a worker.
        jobs: Cores to share out among tasks, each of which takes as many as its rule keeps busy; None is all cores that
            this process may use.
        memory_gb: Memory to share out [GiB]; None is what is available now.
        environment: Variables that workers see beside those of this process.
        capacity: What to share out, over `jobs` and `memory_gb`.
    """

    def __init__(
        self,
        runner: str,
        jobs: int | None = None,
        *,
        memory_gb: float | None = None,
        environment: Mapping[str, str] | None = None,
        capacity: Capacity | None = None,
    ) -> None:
        self.capacity = capacity or Capacity(jobs or _cores(), memory_gb or available_gb())
        self._runner = runner
        self._environment = dict(environment or {})
        self._selector = selectors.DefaultSelector()
        self._idle: list[Process] = []
        self._busy: list[Process] = []
        self._sampler = Sampler()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def warm(self) -> None:
        """Start a worker, which loads what it needs while it is not known yet what it will run."""
        self._idle.append(self._start(()))

    def submit(self, task: Task) -> None:
        """Hand the task to a worker that waits, or to a new one."""
        process = self._take_idle(task.devices) or self._start(task.devices)
        self._busy.append(process)
        process.give(task)

    def poll(self, timeout_s: float | None) -> list[Report]:
        """What workers reported; a worker that died is reported as the failure of its node."""
        reports: list[Report] = []
        for key, _ in self._selector.select(self._sampler.patience(timeout_s, len(self._busy))):
            reports += self._hear(key.data)
        if self._sampler.look(self._busy):
            for process in [process for process in self._busy if process.has_ended]:
                reports += self._hear(process)
        return reports

    def stop(self) -> None:
        """End all workers and everything that they started; those that run may clean up."""
        for process in self._busy:
            process.ask_to_end()
        deadline = time.monotonic() + _GRACE_S
        for process in self._workers():
            self._forget(process)
            process.end(max(0.0, deadline - time.monotonic()) if process.task else 0.0)
        self._busy.clear()
        self._idle.clear()

    def pids(self) -> list[int]:
        """Process ids of all workers."""
        return [process.pid for process in self._workers()]

    def _workers(self) -> list[Process]:
        return [*self._busy, *self._idle]

    def _take_idle(self, devices: tuple[str, ...]) -> Process | None:
        for process in reversed(self._idle):
            if process.devices != devices and set(process.devices).isdisjoint(devices):
                continue
            self._idle.remove(process)
            if process.devices == devices and not process.has_ended:
                return process
            # Dead, or it holds memory of a device that another worker needs now.
            self._forget(process)
            process.end(0.0)
        return None

    def _start(self, devices: tuple[str, ...]) -> Process:
        try:
            process = Process(self._runner, self._environment, devices)
        except OSError as error:
            raise MachineError(
                "a worker process cannot be started",
                code="DXB-E202",
                facts={"system says": error.strerror, "workers": len(self._busy)},
                hint="build with `--jobs 1`",
            ) from None
        self._selector.register(process.descriptor, selectors.EVENT_READ, process)
        return process

    def _hear(self, process: Process) -> list[Report]:
        lines, ended = process.hear()
        reports: list[Report] = []
        for line in lines:
            if process.task is None:  # something that a task left behind goes on talking
                continue
            if "said" in line:
                kind, data = line["said"]
                reports.append(Said(process.task.ticket, kind, data))
            else:
                reports.append(self._end(process, process.task, line))
        if ended:
            reports += self._bury(process)
        return reports

    def _end(self, process: Process, task: Task, line: Mapping[str, Any]) -> Ended:
        process.task = None
        self._busy.remove(process)
        self._idle.append(process)
        told = {
            **line,
            "ticket": task.ticket,
            "log": line.get("log", "").encode("latin-1"),
            "error": from_json(line["error"]) if "error" in line else None,
            "usage": with_peak(line["usage"], process.peak),
        }
        return Ended(**told)

    def _bury(self, process: Process) -> list[Report]:
        """A worker is dead: the task that it had has failed."""
        self._forget(process)
        process.end(_GRACE_S)
        if process.task is None:
            self._idle.remove(process)
            return []
        self._busy.remove(process)
        seconds, log = time.monotonic() - process.began, process.log()
        usage = with_peak({}, process.peak)
        return [Ended(process.task.ticket, seconds, log, error=process.death(log), usage=usage)]

    def _forget(self, process: Process) -> None:
        self._selector.unregister(process.descriptor)


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
