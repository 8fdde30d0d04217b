"""Primitive `lift`: an object is held by hands alone, above its initial height."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import PositiveFloat

from dextera_build.sim.primitives import base
from dextera_build.sim.primitives.base import Past, Setting, TypedGoal
from dextera_build.sim.primitives.stages import DONE, HOLD, MOVE, REACH, clamp, near
from dextera_build.sim.primitives.state import SLIP_M_S as SLIP_M_S
from dextera_build.sim.primitives.state import GraspState, TaskState


class LiftGoal(TypedGoal):
    """The object rises, held by hands alone."""

    primitive: str = "lift"
    names: tuple[str, ...] = ("rise",)
    height_m: float
    """Required rise of the object's origin above its start [m]."""

    def numbers(self, base_from_world: np.ndarray) -> tuple[float, ...]:
        """The rise [m]."""
        return (self.height_m,)


class Options(base.Options):
    """Options of a lift."""

    height_m: PositiveFloat = 0.10
    """Required rise [m]."""

    def goal(self, setting: Setting) -> LiftGoal:
        """The rise."""
        return LiftGoal(height_m=self.height_m)


class Primitive(base.Primitive[LiftGoal]):
    """The object's origin rose by `height_m` and only a valid grasp holds it now.

    A valid grasp has at least two opposing fingers, of one hand or of several, no other support and no slip. A throw
    fails because no fingers press, pinning against the table because of the height and the support.
    """

    goal_type = LiftGoal
    still = "in hand"

    def holds(self, start: TaskState, now: TaskState, past: Past) -> bool:
        """Whether the object is raised and held in the hands that the task names."""
        return base.rise(start, now) >= self.goal.height_m and now.grasp(self.task.limbs).alone

    def target(self) -> tuple[float, float, float]:
        """The target height; any horizontal position."""
        return np.nan, np.nan, float(self.objects[self.task.object].pose.matrix[2, 3]) + self.goal.height_m

    def drawn(self, across_m: np.ndarray, turn_rad: float) -> LiftGoal:
        """Another height."""
        return self.goal.model_copy(update={"height_m": self.goal.height_m + float(across_m[0])})

    def missing(self, start: TaskState, now: TaskState, past: Past) -> str:
        """The reason: the object is too low, or not held."""
        return "the object is not held" if base.rise(start, now) >= self.goal.height_m else "the object is too low"

    def value(self, reach_m: float, start: TaskState, now: TaskState, *, success: bool) -> float:
        """See `value`."""
        share = base.rise(start, now) / self.goal.height_m
        return value(Progress(reach_m, now.grasp(self.task.limbs), share, success))


@dataclass(frozen=True)
class Progress:
    """Progress of lifting."""

    reach_m: float
    """Mean distance of the fingertips from the object's surface [m]."""
    grasp: GraspState
    """Grasp state of the object."""
    rise: float
    """Rise of the object, as a fraction of the required height."""
    success: bool
    """Whether the task is done."""


def value(progress: Progress) -> float:
    """Value of a state: reach, then hold with opposing forces, then rise, then success."""
    grasp = progress.grasp
    hold = 0.5 * min(grasp.fingers, 2) / 2 + 0.5 * float(grasp.opposing)
    held = grasp.fingers >= 2 and grasp.opposing
    rise = clamp(progress.rise, 0.0, 1.0) if held else 0.0
    return REACH * near(progress.reach_m) + HOLD * hold + MOVE * rise + DONE * float(progress.success)
