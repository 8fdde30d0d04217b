"""Target poses as options of a recipe and as conditions, shared by the primitives that move an object to a pose."""

from __future__ import annotations

from typing import Self

import numpy as np
from pydantic import Field, PositiveFloat, model_validator

from dextera_build.artifacts.core.value import Value
from dextera_build.geometry import lie, quaternions
from dextera_build.sim.primitives import base
from dextera_build.sim.primitives.base import Setting, TypedGoal, lengths
from dextera_build.sim.primitives.stages import clamp

RADIAN_M = 0.1
"""Distance equivalent to a rotation by one radian [m]."""


Place = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class Tolerance(Value):
    """Tolerance of a target pose."""

    position_m: float
    """Maximum distance of the object's origin [m]."""
    rotation_rad: float
    """Maximum rotation between both orientations [rad]."""
    symmetry: int = 1
    """Order of the object's rotational symmetry about its own z axis; 0: any rotation."""

    def met(self, position_m: np.ndarray, rotation_rad: np.ndarray) -> np.ndarray:
        """Whether distances and rotations (N,) from the target are within tolerance (N,); False on NaN."""
        return (position_m <= self.position_m) & (rotation_rad <= self.rotation_rad)


class PoseGoal(TypedGoal):
    """A target pose."""

    names: tuple[str, ...] = tuple(f"target_{part}" for part in ("x", "y", "z", "qw", "qx", "qy", "qz"))
    place_m: Place | None = None
    """Target position of the object's origin [m]; None: any."""
    quaternion: Quaternion | None = None
    """Target orientation, w x y z; None: any."""
    tolerance: Tolerance
    """Tolerance."""

    def moved(self, across_m: np.ndarray, turn_rad: float) -> Self | None:
        """The target displaced by (2,) on the support [m] and turned about the vertical; None without a position."""
        if self.place_m is None:
            return None
        x, y = (np.array(self.place_m[:2]) + across_m).tolist()
        found = self.model_copy(update={"place_m": (x, y, self.place_m[2])})
        if self.quaternion is None:
            return found
        about = quaternions.from_matrix(lie.rotation(np.array([0.0, 0.0, turn_rad])))
        turned = quaternions.multiply(about, np.array(self.quaternion))
        return found.model_copy(update={"quaternion": tuple(turned.tolist())})

    def numbers(self, base_from_world: np.ndarray) -> tuple[float, ...]:
        """Target position [m] and quaternion; zeros for unconstrained parts."""
        place, turn = np.zeros(3), np.zeros(4)
        if self.place_m is not None:
            place = (base_from_world @ [*self.place_m, 1.0])[:3]
        if self.quaternion is not None:
            matrix = base_from_world[:3, :3] @ quaternions.to_matrix(np.array(self.quaternion))
            turn = quaternions.from_matrix(matrix)
            turn = turn if turn[0] >= 0 else -turn
        return (*map(float, place), *map(float, turn))


class Near(base.Options):
    """Options for the tolerance of a target."""

    tolerance_m: PositiveFloat = 0.03
    """Maximum distance from the target [m]."""
    tolerance_deg: PositiveFloat = 15.0
    """Maximum rotation from the target [deg]."""
    symmetry: int = Field(1, ge=0)
    """Order of the object's rotational symmetry about its own z axis; 0: any rotation."""

    def tolerance(self) -> Tolerance:
        """The tolerances of distance and rotation."""
        return Tolerance(
            position_m=self.tolerance_m, rotation_rad=float(np.radians(self.tolerance_deg)), symmetry=self.symmetry
        )


class Options(Near):
    """Options of a target pose in the twin's world."""

    to_m: tuple[float, float, float] | None = None
    """Target x, y and z of the object's origin in the world [m]."""
    by_m: tuple[float, float, float] | None = None
    """The same, as a displacement from the photographed position [m]."""
    turn_deg: tuple[float, float, float] | None = None
    """Target orientation as rotations of the photographed one about x, then y, then z of the world [deg]."""

    @model_validator(mode="after")
    def _aimed_once(self) -> Options:
        if self.to_m is not None and self.by_m is not None:
            raise ValueError("`by_m` and `to_m` both give a target; leave one of them out")
        return self

    def place(self, setting: Setting) -> Place | None:
        """Target position in the world [m], or None for any."""
        if self.by_m is not None:
            x, y, z = (setting.objects[setting.object].pose.matrix[:3, 3] + self.by_m).tolist()
            return x, y, z
        return self.to_m

    def quaternion(self, setting: Setting) -> Quaternion | None:
        """Target orientation in the world, or None for any."""
        if self.turn_deg is None:
            return None
        turn = np.eye(3)
        for axis, angle in zip(np.eye(3), np.radians(self.turn_deg), strict=True):
            turn = lie.rotation(axis * angle) @ turn
        w, x, y, z = quaternions.from_matrix(turn @ setting.objects[setting.object].pose.matrix[:3, :3]).tolist()
        return w, x, y, z


def errors(goal: PoseGoal, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances [m] and rotations [rad] of poses (N, 4, 4) from their target (N,); 0 for an unconstrained part."""
    position = rotation = np.zeros(len(pose))
    if goal.place_m is not None:
        position = lengths(pose[:, :3, 3] - goal.place_m)
    if goal.quaternion is not None:
        wanted = quaternions.to_matrix(np.array(goal.quaternion))
        rotation = base.apart(pose[:, :3, :3], wanted, goal.tolerance.symmetry)
    return position, rotation


def reached(goal: PoseGoal, pose: np.ndarray) -> np.ndarray:
    """Whether poses (N, 4, 4) are within tolerance of their target (N,); False on NaN."""
    return np.asarray(np.isfinite(pose).all(axis=(1, 2)) & goal.tolerance.met(*errors(goal, pose)))


def way_m(position_m: np.ndarray, rotation_rad: np.ndarray) -> np.ndarray:
    """Distances and rotations (N,) from a target combined into one distance (N,) [m]."""
    return position_m + RADIAN_M * rotation_rad


def left(goal: PoseGoal, start: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Distances of poses (N, 4, 4) from the target, as a fraction of that at the start, at most 2 (N,)."""
    before, after = way_m(*errors(goal, start)), way_m(*errors(goal, now))
    return np.asarray(np.fmin(2.0, after / np.maximum(before, goal.tolerance.position_m)))


def turned(pose: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Angles between an object's own z axis and its direction at the start (N,) [rad], of poses (N, 4, 4)."""
    return np.asarray(np.arccos(clamp(np.vecdot(start[:, :3, 2], pose[:, :3, 2]), -1.0, 1.0)))


def seen_from(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (N, 3) of the world in the frames of poses (N, 4, 4) [m]."""
    return np.asarray(((points - pose[:, :3, 3])[:, None] @ pose[:, :3, :3])[:, 0])
