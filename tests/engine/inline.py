"""An executor that runs nodes in this very process, one after another."""

from __future__ import annotations

import io
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import redirect_stderr
from dataclasses import replace
from typing import Any

from dextera_build.workers.capacity import Capacity
from dextera_build.workers.protocol import Ended, Report, Said, Task
from dextera_build.workers.worker import attempt

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
        said = io.StringIO()

        def emit(kind: str, data: Mapping[str, Any]) -> None:
            reports.append(Said(task.ticket, kind, data))
            if kind == "log":
                said.write(f"{data['text']}\n")

        with redirect_stderr(said):
            ended = attempt(lambda: self._runner(task.message(), emit), task.project)
        return [*reports, Ended(task.ticket, log=said.getvalue().encode(), **ended)]
