"""Primitive `push`: an object is moved along its support to a position, without being lifted."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from pydantic import model_validator

from dextera_build.artifacts.tasks.task import TaskObject, TaskSpec
from dextera_build.geometry import lie, quaternions
from dextera_build.sim.primitives import base, poses
from dextera_build.sim.primitives.base import Past, Setting, TypedGoal, lengths
from dextera_build.sim.primitives.poses import Quaternion, Tolerance
from dextera_build.sim.primitives.stages import DONE, MOVE, REACH, clamp, near
from dextera_build.sim.primitives.state import TaskState

LIFTED_M = 0.03
"""Rise above which an object was lifted rather than pushed [m]."""
STANDS_M = 0.015
"""Height difference within which an object still stands on its support [m]."""
UNTOUCHED, TOUCHED = 0, 1
"""Stages: no hand has touched the object; one has."""


class PushGoal(TypedGoal):
    """The object stands at a position on its support, to which it was pushed."""

    primitive: str = "push"
    names: tuple[str, ...] = ("x", "y", "heading_x", "heading_y")
    place_m: tuple[float, float]
    """Target x and y of the object's origin [m]."""
    yaw_rad: float | None
    """Target rotation from the photographed orientation about the vertical [rad]; None: any."""
    upright: Quaternion
    """Photographed orientation, w x y z, relative to which the rotation is defined."""
    tolerance: Tolerance
    """Tolerance."""

    @property
    def turn(self) -> np.ndarray:
        """Target rotation (3, 3); the photographed one if any rotation is accepted."""
        about = lie.rotation(np.array([0.0, 0.0, self.yaw_rad or 0.0]))
        return np.asarray(about @ quaternions.to_matrix(np.array(self.upright)))

    def numbers(self, base_from_world: np.ndarray) -> tuple[float, ...]:
        """Target position on the support [m], and direction of the object's x axis there; zeros for any rotation."""
        place = base_from_world @ [*self.place_m, 0.0, 1.0]
        ahead = base_from_world[:3, :3] @ self.turn[:, 0] * (self.yaw_rad is not None)
        return (*map(float, place[:2]), *map(float, ahead[:2]))


class Options(poses.Near):
    """Options of a push."""

    to_m: tuple[float, float] | None = None
    """Target x and y of the object's origin in the world [m]."""
    by_m: tuple[float, float] | None = None
    """The same, as a displacement from the photographed position [m]."""
    yaw_deg: float | None = None
    """Target rotation about the vertical from the photographed orientation [deg]; None: any."""

    @model_validator(mode="after")
    def _aimed(self) -> Options:
        if (self.to_m is None) == (self.by_m is None):
            raise ValueError("it needs one target; set `by_m: [0.1, 0.0]`, a way from the photograph, or `to_m`")
        return self

    def goal(self, setting: Setting) -> PushGoal:
        """The target on the support."""
        pose = setting.objects[setting.object].pose.matrix
        x, y = (pose[:2, 3] + self.by_m).tolist() if self.by_m is not None else self.to_m or (0.0, 0.0)
        w, i, j, k = quaternions.from_matrix(pose[:3, :3]).tolist()
        return PushGoal(
            place_m=(x, y),
            yaw_rad=None if self.yaw_deg is None else float(np.radians(self.yaw_deg)),
            upright=(w, i, j, k),
            tolerance=self.tolerance(),
        )


class Primitive(base.Primitive[PushGoal]):
    """The object stands at its target within tolerance, after a hand pushed it there.

    An episode fails if the object was lifted, was touched by a hand that the task does not name, or jumped.
    """

    goal_type = PushGoal
    shaped = False
    carries = False
    stages = ("touched", "halfway", "at its target")

    def __init__(self, task: TaskSpec, objects: Mapping[str, TaskObject] | None = None) -> None:
        super().__init__(task, objects)
        self._turn = self.goal.turn

    def holds(self, start: TaskState, now: TaskState, past: Past) -> np.ndarray:
        """Whether the object was pushed, stands, and is at its target."""
        stands = (np.abs(base.rise(start, now)) <= STANDS_M) & now.supported
        return np.asarray((past.stage == TOUCHED) & stands & self.goal.tolerance.met(*self._errors(now)))

    def follow(self, past: Past, start: TaskState, now: TaskState) -> Past:
        """Whether a hand has touched it, and whether it was lifted or jumped."""
        touched = now.touched()
        lifted = ~(base.rise(start, now) <= LIFTED_M) | (now.grasp().alone & past.before.grasp().alone)
        found = {"the object jumped": base.jumped(past.before, now), "the object was lifted": lifted}
        if self.task.limbs:
            found["another hand touched the object"] = now.touched(but=self.task.limbs)
        return Past(now, np.where(touched, TOUCHED, past.stage), base.faulted(past.fault, found), past.mark)

    def missing(self, start: TaskState, now: TaskState, past: Past) -> np.ndarray:
        """The reason: the object was not touched, does not stand, or is not at its target."""
        there = self.goal.tolerance.met(*self._errors(now))
        reason = np.where(there, "the object does not stand", "the object is not at its target")
        return np.where(past.stage == UNTOUCHED, "the object was not pushed", reason)

    def reached(self, start: TaskState, now: TaskState, past: Past) -> np.ndarray:
        """Touched by a hand, then half of the way, then at its target, even if it does not stand there."""
        touched = past.stage == TOUCHED
        there = self.goal.tolerance.met(*self._errors(now))
        return base.furthest(touched, touched & (self._left(start, now) <= 0.5), touched & there)

    def value(self, reach_m: np.ndarray, start: TaskState, now: TaskState, success: np.ndarray) -> np.ndarray:
        """Value of the stages: reach, move the object to its target; a lifted object has made no progress."""
        stands = base.rise(start, now) <= LIFTED_M
        left = np.where(stands, self._left(start, now), 1.0)
        moved = 1.0 - clamp(left, 0.0, 2.0)
        reach = 1.0 - (1.0 - near(reach_m)) * np.fmin(1.0, left)
        return np.asarray(REACH * reach + MOVE * moved + DONE * success)

    @property
    def near_m(self) -> float:
        """The tolerance of the position."""
        return self.goal.tolerance.position_m

    def drawn(self, across_m: np.ndarray, turn_rad: float) -> PushGoal:
        """Another position, and another rotation if there is one."""
        x, y = (np.array(self.goal.place_m) + across_m).tolist()
        yaw = None if self.goal.yaw_rad is None else self.goal.yaw_rad + turn_rad
        return self.goal.model_copy(update={"place_m": (x, y), "yaw_rad": yaw})

    def fair(self, places: Mapping[str, np.ndarray]) -> np.ndarray:
        """Whether the object does not stand at its target yet."""
        return ~self.goal.tolerance.met(*self._away(places[self.task.object]))

    def target(self) -> tuple[float, float, float]:
        """The position on the support."""
        return *self.goal.place_m, float(self.objects[self.task.object].pose.matrix[2, 3])

    def _left(self, start: TaskState, now: TaskState) -> np.ndarray:
        """Distance from the target (N,), as a fraction of that at the start."""
        before, after = (poses.way_m(*self._errors(state)) for state in (start, now))
        return np.asarray(after / np.maximum(before, 1e-6))

    def _errors(self, state: TaskState) -> tuple[np.ndarray, np.ndarray]:
        return state.once("errors", self.goal, lambda each: self._away(each.world_from_object))

    def _away(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances on the support [m] and rotations [rad] (N,) of poses from the target; NaN if a pose is NaN."""
        symmetry = self.goal.tolerance.symmetry if self.goal.yaw_rad is not None else 0
        position = lengths(pose[:, :2, 3] - self.goal.place_m)
        return position, base.apart(pose[:, :3, :3], self._turn, symmetry)
