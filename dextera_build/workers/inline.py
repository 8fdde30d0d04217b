"""Nodes run in this very process, one after another: for tests of rules, and where a debugger must step in."""

from __future__ import annotations

import time
import traceback
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from dextera_build.errors import DxbError
from dextera_build.workers.capacity import Capacity
from dextera_build.workers.protocol import Ended, Report, Said, Task, escaped
from dextera_build.workers.retries import names_of
from dextera_build.workers.usage import Meter

Emit = Callable[[str, Mapping[str, Any]], None]
Runner = Callable[[Mapping[str, Any], Emit], Mapping[str, Any]]
"""(task, emit) -> {"output", "line", "previews", "metrics"}."""


class InlineExecutor:
    """Runs a task when it is asked what happened.

    Args:
        runner: What carries out a task.
        capacity: Devices and named resources, where the rules need some; it has one core in any case.
    """

    def __init__(self, runner: Runner, capacity: Capacity | None = None) -> None:
        self.capacity = replace(capacity or Capacity(memory_gb=1e6), cpus=1)
        self._runner = runner
        self._meter = Meter()
        self._waiting: deque[Task] = deque()

    def submit(self, task: Task) -> None:
        """Keep the task until `poll`."""
        self._waiting.append(task)

    def poll(self, timeout_s: float | None) -> list[Report]:
        """Run what was submitted."""
        reports: list[Report] = []
        while self._waiting:
            reports += self._run(self._waiting.popleft())
        return reports

    def stop(self) -> None:
        """Forget what was submitted."""
        self._waiting.clear()

    def _run(self, task: Task) -> list[Report]:
        reports: list[Report] = []
        log: list[str] = []

        def emit(kind: str, data: Mapping[str, Any]) -> None:
            reports.append(Said(task.ticket, kind, data))
            if kind == "log":
                log.append(f"{data['text']}\n")

        reply: Mapping[str, Any] | None = None
        error: DxbError | None = None
        raised: list[str] = []
        self._meter.begin()
        began = time.monotonic()
        try:
            reply = self._runner(task.message(), emit)
        except DxbError as known:
            error = known
        except Exception as unknown:
            log.append(traceback.format_exc())
            error, raised = escaped(unknown, task.project), names_of(unknown)
        seconds = time.monotonic() - began
        said = "".join(log).encode()
        reports.append(Ended(task.ticket, seconds, said, reply, error, tuple(raised), self._meter.end()))
        return reports
