"""Primitive `pick_and_reorient`: a hand holds an object at a target pose, off its support."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from pydantic import model_validator

from dextera_build.sim.primitives import base, poses
from dextera_build.sim.primitives.base import Past, Setting
from dextera_build.sim.primitives.stages import DONE, HOLD, MOVE, REACH, clamp, holding, near
from dextera_build.sim.primitives.state import TaskState


class ReorientGoal(poses.PoseGoal):
    """A hand holds the object at a target pose, off its support."""

    primitive: str = "pick_and_reorient"


class Options(poses.Options):
    """Options of a reorientation: a position, an orientation, or both."""

    @model_validator(mode="after")
    def _aimed(self) -> Options:
        if self.turn_deg is None and self.by_m is None and self.to_m is None:
            raise ValueError("there is no target; set `turn_deg: [90, 0, 0]`, `by_m` or `to_m`")
        return self

    def goal(self, setting: Setting) -> ReorientGoal:
        """The target pose."""
        place, quaternion = self.place(setting), self.quaternion(setting)
        return ReorientGoal(place_m=place, quaternion=quaternion, tolerance=self.tolerance())


class Primitive(base.Primitive[ReorientGoal]):
    """The object's pose is within tolerance of its target, and only a valid grasp holds it there."""

    goal_type = ReorientGoal
    shaped = False
    stages = ("touched", "grasped", "off its support", "at its target")

    def holds(self, start: TaskState, now: TaskState, past: Past) -> np.ndarray:
        """Whether the object is at its target, in the hands that the task names."""
        held = now.grasp(self.task.limbs).alone
        return np.asarray(held & poses.reached(self.goal, now.world_from_object))

    def follow(self, past: Past, start: TaskState, now: TaskState) -> Past:
        """Whether the object jumped."""
        fault = base.faulted(past.fault, {"the object jumped": base.jumped(past.before, now)})
        return Past(now, past.stage, fault, past.mark)

    def reached(self, start: TaskState, now: TaskState, past: Past) -> np.ndarray:
        """Touched by a hand, between opposing fingers, held by hands alone, and that at its target."""
        grasp = now.grasp(self.task.limbs)
        return base.furthest(now.touched(), grasp.held, grasp.alone, self.holds(start, now, past))

    def target(self) -> tuple[float, float, float] | None:
        """The target position, if there is one."""
        return self.goal.place_m

    @property
    def near_m(self) -> float:
        """The tolerance of the position."""
        return self.goal.tolerance.position_m

    def drawn(self, across_m: np.ndarray, turn_rad: float) -> ReorientGoal | None:
        """Another target pose."""
        return self.goal.moved(across_m, turn_rad)

    def missing(self, start: TaskState, now: TaskState, past: Past) -> np.ndarray:
        """The reason: the object is not at its target, or not held."""
        reached = poses.reached(self.goal, now.world_from_object)
        return np.where(reached, "the object is not held", "the object is not at its target")

    def value(self, reach_m: np.ndarray, start: TaskState, now: TaskState, success: np.ndarray) -> np.ndarray:
        """Value of the stages: reach, hold, move to the target in the hand."""
        grasp = now.grasp(self.task.limbs)
        moved = np.zeros(len(reach_m))
        if grasp.held.any():
            left = poses.left(self.goal, start.world_from_object, now.world_from_object)
            moved = np.where(grasp.held, clamp(1.0 - left, 0.0, 1.0), 0.0)
        return np.asarray(REACH * near(reach_m) + HOLD * holding(grasp) + MOVE * moved + DONE * success)

    def fair(self, places: Mapping[str, np.ndarray]) -> np.ndarray:
        """Whether the object is not at its target yet."""
        return ~poses.reached(self.goal, places[self.task.object])
