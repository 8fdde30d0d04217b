"""Success of a task: pure functions of quantities that can be measured in any world.

Independent of any simulator. The condition is judged once per control period; success means that it did not hold at
the reset and then held without interruption for `hold_s`. Any interruption restarts the clock.
"""

from __future__ import annotations

from dextera_build.artifacts.task import TaskSpec
from dextera_build.sim.primitives import articulate, lift
from dextera_build.sim.primitives.state import TaskState

_CONDITIONS = {"lift": lift.succeeded, "articulate": articulate.succeeded}


def holds(task: TaskSpec, start: TaskState, now: TaskState) -> bool:
    """Whether the task's condition holds now, given the state at the start of the episode."""
    return _CONDITIONS[task.primitive](task, start, now)


class Judge:
    """Follows one episode and decides when it has succeeded.

    Args:
        task: The objective.
        start: State at the reset.
    """

    def __init__(self, task: TaskSpec, start: TaskState) -> None:
        self.task = task
        self.start = start
        self.held_at_reset = holds(task, start, start)
        self._since: float | None = None

    def update(self, now: TaskState) -> bool:
        """Process one control period; True once the condition has held for `hold_s`."""
        if self.held_at_reset or not holds(self.task, self.start, now):
            self._since = None
            return False
        if self._since is None:
            self._since = now.time_s
        return now.time_s - self._since >= self.task.hold_s - 1e-9
