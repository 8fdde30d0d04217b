"""Success of a task: pure functions of quantities that can be measured in any world.

Independent of any simulator. The condition is evaluated once per control period; success means that it did not hold at
the reset and then held without interruption for `hold_s`. Any interruption restarts the timer.
"""

from __future__ import annotations

from collections.abc import Mapping

from dextera_build.artifacts.tasks.task import TaskObject, TaskSpec
from dextera_build.sim.primitives import catalogue
from dextera_build.sim.primitives.base import Past
from dextera_build.sim.primitives.state import TaskState


def holds(task: TaskSpec, start: TaskState, now: TaskState, objects: Mapping[str, TaskObject] | None = None) -> bool:
    """Whether the task's condition holds now, given only the state at the start of the episode."""
    primitive = catalogue.of(task, objects)
    past = Past(start)
    return primitive.holds(start, now, past if now is start else primitive.follow(past, start, now))


class Judge:
    """Follows one episode and decides when it has succeeded.

    Args:
        task: The objective.
        start: State at the reset.
        objects: Body -> object of the task's model, for conditions on shapes.
    """

    def __init__(self, task: TaskSpec, start: TaskState, objects: Mapping[str, TaskObject] | None = None) -> None:
        self.task = task
        self.start = start
        self.primitive = catalogue.of(task, objects)
        self._past = Past(start)
        self._now = start
        self.held_at_reset = self.primitive.holds(start, start, self._past)
        self._since: float | None = None

    @property
    def reason(self) -> str:
        """Reason why the condition does not hold, in a few words; empty if it holds."""
        if self.primitive.holds(self.start, self._now, self._past):
            return ""
        return self._past.fault or self.primitive.missing(self.start, self._now, self._past)

    def update(self, now: TaskState) -> bool:
        """Process one control period; True once the condition has held for `hold_s`."""
        self._past, self._now = self.primitive.follow(self._past, self.start, now), now
        held = not self._past.fault and self.primitive.holds(self.start, now, self._past)
        if self.held_at_reset or not held:
            self._since = None
            return False
        if self._since is None:
            self._since = now.time_s
        return now.time_s - self._since >= self.task.hold_s - 1e-9
