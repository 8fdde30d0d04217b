"""An executor that stands for `-j N`: what was submitted ends in any order, in this process, and may go wrong."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace

from dextera_build.errors import RuleError
from dextera_build.workers.protocol import Ended, Report
from tests.engine.inline import InlineExecutor
from tests.engine.tiny import run_task


class Shuffled(InlineExecutor):
    """Runs one of the waiting tasks when it is asked what happened.

    Args:
        jobs: Cores.
        seed: Of the order.
        disturb: Called with the number of each task, from 1, before it ends; True: its worker died.
    """

    def __init__(self, jobs: int, seed: float, disturb: Callable[[int], bool] = lambda number: False) -> None:
        super().__init__(run_task)
        self.capacity = replace(self.capacity, cpus=jobs)
        self._random = random.Random(seed)
        self._disturb = disturb
        self._count = 0

    def poll(self, timeout_s: float | None) -> list[Report]:
        """End one task."""
        if not self._waiting:
            return []
        self._waiting.rotate(self._random.randrange(len(self._waiting)))
        task = self._waiting.popleft()
        self._count += 1
        reports = self._run(task)
        if self._disturb(self._count):
            died = RuleError("its worker died", code="DXB-B301")
            return [Ended(task.ticket, 0.0, b"", error=died)]
        return reports
