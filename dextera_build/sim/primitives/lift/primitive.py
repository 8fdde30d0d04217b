"""Primitive `lift`: an object is held by hands alone, above its initial height."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import PositiveFloat

from dextera_build.sim.primitives import base
from dextera_build.sim.primitives.base import Past, Setting, TypedGoal
from dextera_build.sim.primitives.stages import DONE, HOLD, MOVE, REACH, clamp, holding, near
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
    shaped = False
    still = "in hand"
    stages = ("touched", "grasped", "off its support", "raised")

    def holds(self, start: TaskState, now: TaskState, past: Past) -> np.ndarray:
        """Whether the object is raised and held in the hands that the task names."""
        return np.asarray((base.rise(start, now) >= self.goal.height_m) & now.grasp(self.task.limbs).alone)

    def reached(self, start: TaskState, now: TaskState, past: Past) -> np.ndarray:
        """Touched by a hand, between opposing fingers, held by hands alone, and that at the required height."""
        grasp = now.grasp(self.task.limbs)
        return base.furthest(now.touched(), grasp.held, grasp.alone, self.holds(start, now, past))

    def target(self) -> tuple[float, float, float]:
        """The target height; any horizontal position."""
        return np.nan, np.nan, float(self.objects[self.task.object].pose.matrix[2, 3]) + self.goal.height_m

    def drawn(self, across_m: np.ndarray, turn_rad: float) -> LiftGoal:
        """Another height."""
        return self.goal.model_copy(update={"height_m": self.goal.height_m + float(across_m[0])})

    def missing(self, start: TaskState, now: TaskState, past: Past) -> np.ndarray:
        """The reason: the object is too low, or not held."""
        raised = base.rise(start, now) >= self.goal.height_m
        return np.where(raised, "the object is not held", "the object is too low")

    def value(self, reach_m: np.ndarray, start: TaskState, now: TaskState, success: np.ndarray) -> np.ndarray:
        """See `value`."""
        share = base.rise(start, now) / self.goal.height_m
        return value(Progress(reach_m, now.grasp(self.task.limbs), share, success))


@dataclass(eq=False)
class Progress:
    """Progress of lifting in N worlds."""

    reach_m: np.ndarray
    """Mean distance of the fingertips from the object's surface (N,) [m]."""
    grasp: GraspState
    """Grasp state of the object."""
    rise: np.ndarray
    """Rise of the object (N,), as a fraction of the required height."""
    success: np.ndarray
    """Whether the task is done (N,)."""


def value(progress: Progress) -> np.ndarray:
    """Values of states (N,): reach, then hold with opposing forces, then rise, then success."""
    grasp = progress.grasp
    rise = np.where(grasp.held, clamp(progress.rise, 0.0, 1.0), 0.0)
    found = REACH * near(progress.reach_m) + HOLD * holding(grasp) + MOVE * rise + DONE * progress.success
    return np.asarray(found)
