"""Success of a task: pure functions of quantities that can be measured in any world.

Independent of any simulator. The condition is evaluated once per control period; success means that it did not hold at
the reset and then held without interruption for `hold_s`. Any interruption restarts the timer.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dextera_build.artifacts.tasks.task import TaskObject, TaskSpec
from dextera_build.sim.primitives import catalogue
from dextera_build.sim.primitives.base import Past
from dextera_build.sim.primitives.state import TaskState, chosen


def holds(
    task: TaskSpec, start: TaskState, now: TaskState, objects: Mapping[str, TaskObject] | None = None
) -> np.ndarray:
    """Whether the task's condition holds now (N,), given only the states at the start of the episodes."""
    primitive = catalogue.of(task, objects)
    past = Past.begun(start)
    past = past if now is start else primitive.follow(past, start, now)
    return np.asarray(primitive.holds(start, now, past) & (past.fault == ""))


class Judge:
    """Follows one episode in each of N worlds and decides when it has succeeded.

    Args:
        task: The objective.
        start: States at the reset.
        objects: Body -> object of the task's model, for conditions on shapes.
        staged: Whether `stage` is followed, which takes about as long as the verdict; if not, it is 0.
    """

    def __init__(
        self,
        task: TaskSpec,
        start: TaskState,
        objects: Mapping[str, TaskObject] | None = None,
        *,
        staged: bool = False,
    ) -> None:
        self.task = task
        self.start = start
        self.primitive = catalogue.of(task, objects)
        self._past = Past.begun(start)
        self._now = start
        self.held_at_reset = self.primitive.holds(start, start, self._past)
        """Whether the condition held at the reset already (N,)."""
        self.stage = np.zeros(len(start.time_s), int)
        """The last of the primitive's stages that was reached so far, without a fault, from 1 (N,); 0: none."""
        self._staged = staged and bool(self.primitive.stages)
        self._never = np.full(len(start.time_s), np.inf)
        self._since = self._never

    def begin(self, worlds: np.ndarray, now: TaskState) -> None:
        """Begin new episodes in some of the worlds.

        Args:
            worlds: Whether a world begins (N,) bool.
            now: States of all worlds; those of the others are not used.
        """
        self.start, self._now = chosen(worlds, now, self.start), chosen(worlds, now, self._now)
        self._past = Past.begun(now).where(worlds, self._past)
        self.held_at_reset = self.primitive.holds(self.start, self.start, Past.begun(self.start))
        self.stage = np.where(worlds, 0, self.stage)
        self._since = np.where(worlds, self._never, self._since)

    @property
    def reasons(self) -> np.ndarray:
        """Reasons why the condition does not hold (N,) str, in a few words; empty if it holds."""
        fault, parts = self._past.fault, (self.start, self._now, self._past)
        missing = np.where(self.primitive.holds(*parts), "", self.primitive.missing(*parts))
        return np.where(fault == "", missing, fault)

    def update(self, now: TaskState, worlds: np.ndarray | None = None) -> np.ndarray:
        """Process one control period (N,); True once the condition has held for `hold_s`.

        Args:
            now: The current states.
            worlds: Whether a world moved on (N,) bool; the others have their earlier states. None: all did.
        """
        past = self.primitive.follow(self._past, self.start, now)
        self._past, self._now = past if worlds is None else past.where(worlds, self._past), now
        fine = self._past.fault == ""
        if self._staged:
            reached = self.primitive.reached(self.start, now, self._past)
            self.stage = np.maximum(self.stage, np.where(fine, reached, 0))
        held = self.primitive.holds(self.start, now, self._past) & fine & ~self.held_at_reset
        self._since = np.where(held, np.minimum(self._since, now.time_s), self._never)
        return np.asarray(now.time_s - self._since >= self.task.hold_s - 1e-9)
