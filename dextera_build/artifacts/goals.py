"""Goals of tasks: one type per primitive, in the world frame [m, rad].

In the observations of policies a goal is a vector with named components, in the robot's base frame like all
observations.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from dextera_build.artifacts.value import Value
from dextera_build.geometry import lie, quaternions

Place = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class LiftGoal(Value):
    """The object rises, held by hands alone."""

    primitive: Literal["lift"] = "lift"
    height_m: float
    """Required rise of the object's origin above its start [m]."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of `numbers`."""
        return ("rise",)

    def numbers(self, base_from_world: np.ndarray) -> tuple[float, ...]:
        """The rise [m]."""
        return (self.height_m,)


class ArticulateGoal(Value):
    """Joints of the object are at commanded positions."""

    primitive: Literal["articulate"] = "articulate"
    joints: dict[str, float]
    """Joint in the model -> commanded position [rad or m]."""
    tolerance: float
    """Maximum deviation of every joint from its command [rad or m]."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of `numbers`."""
        return tuple(self.joints)

    def numbers(self, base_from_world: np.ndarray) -> tuple[float, ...]:
        """The commanded positions [rad or m]."""
        return tuple(self.joints.values())


class Tolerance(Value):
    """Tolerance of a target pose."""

    position_m: float
    """Maximum distance of the object's origin [m]."""
    rotation_rad: float
    """Maximum rotation between both orientations [rad]."""
    symmetry: int = 1
    """Order of the object's rotational symmetry about its own z axis; 0: any rotation."""

    def met(self, position_m: float, rotation_rad: float) -> bool:
        """Whether a distance and a rotation from the target are within tolerance; False on NaN."""
        return position_m <= self.position_m and rotation_rad <= self.rotation_rad


class PushGoal(Value):
    """The object stands at a position on its support, to which it was pushed."""

    primitive: Literal["push"] = "push"
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

    @property
    def names(self) -> tuple[str, ...]:
        """Names of `numbers`."""
        return ("x", "y", "heading_x", "heading_y")

    def numbers(self, base_from_world: np.ndarray) -> tuple[float, ...]:
        """Target position on the support [m], and direction of the object's x axis there; zeros for any rotation."""
        place = base_from_world @ [*self.place_m, 0.0, 1.0]
        ahead = base_from_world[:3, :3] @ self.turn[:, 0] * (self.yaw_rad is not None)
        return (*map(float, place[:2]), *map(float, ahead[:2]))


class PoseGoal(Value):
    """A target pose."""

    place_m: Place | None = None
    """Target position of the object's origin [m]; None: any."""
    quaternion: Quaternion | None = None
    """Target orientation, w x y z; None: any."""
    tolerance: Tolerance
    """Tolerance."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of `numbers`."""
        return tuple(f"target_{part}" for part in ("x", "y", "z", "qw", "qx", "qy", "qz"))

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


class ReorientGoal(PoseGoal):
    """A hand holds the object at a target pose, off its support."""

    primitive: Literal["pick_and_reorient"] = "pick_and_reorient"


class PlaceGoal(PoseGoal):
    """The object was picked up, and rests released at a target pose, or inside a container."""

    primitive: Literal["pick_and_place"] = "pick_and_place"
    into: str = ""
    """Body of the container whose cavity must contain the whole object; empty: the target pose applies."""


class HandoverGoal(Value):
    """One hand takes the object from the other."""

    primitive: Literal["handover"] = "handover"
    giver: str
    """Limb that holds it first."""
    receiver: str
    """Limb that holds it at the end."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of `numbers`."""
        return (f"receiver_is_{self.receiver}",)

    def numbers(self, base_from_world: np.ndarray) -> tuple[float, ...]:
        """1: the receiver is part of the name."""
        return (1.0,)


Goal = LiftGoal | ArticulateGoal | PushGoal | ReorientGoal | PlaceGoal | HandoverGoal
"""The goal of a task; its type identifies the primitive."""
Primitive = Literal["lift", "articulate", "push", "pick_and_reorient", "pick_and_place", "handover"]
"""Kind of objective; each has a file in `dextera_build.sim.primitives`."""
