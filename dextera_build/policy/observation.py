"""Deployable and privileged observations, as two types to prevent confusion.

Table I of the paper; `declared` describes every field. Deployable values are also available from sensors and an object
tracker on hardware; privileged ones are read from the simulator's state, for teachers and critics only. Poses and
forces are expressed in the robot's base frame, which is available on hardware without a world frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Frame:
    """One camera's frame."""

    rgb: np.ndarray | None = None
    """Picture (H, W, 3) uint8 sRGB, or None."""
    depth: np.ndarray | None = None
    """Image-plane distance (H, W) float32 [m], 0 where nothing was measured, or None."""
    cloud: np.ndarray | None = None
    """Points (H, W, 3) float32 [m] in the camera's frame, back-projected from `depth`, or None."""


Frames = Mapping[str, Frame]
"""Camera -> its frame."""
PICTURE = "workspace"
"""Name of a single camera."""


@dataclass(frozen=True)
class Measurement:
    """The measurements of a robot cell in one control period; simulated and real cells fill in the same fields."""

    joints: np.ndarray
    """Positions of the robot's joints (A,) [rad]."""
    objects: np.ndarray
    """Tracked poses of the objects (O, 7): position [m], unit quaternion w x y z with w >= 0, in the base frame."""
    displacement: np.ndarray
    """Positions of the objects' joints (K,) [rad or m]."""
    frames: Frames = field(default_factory=dict)
    """Frames of all cameras."""


@dataclass(frozen=True)
class DeployableObservation:
    """All inputs that a policy may use, made from a `Measurement`, never from a simulator's state."""

    previous_action: np.ndarray
    """Last joint targets sent (A,) float32 [rad]."""
    joints: np.ndarray
    """Positions of the robot's joints (A,) float32 [rad]."""
    objects: np.ndarray
    """Poses of the objects (O, 7) float32 in the base frame."""
    displacement: np.ndarray
    """Positions of the objects' joints (K,) float32 [rad or m]."""
    goal: np.ndarray
    """Goal (G,) float32 in the base frame, see `dextera_build.artifacts.goals`."""
    frames: Frames = field(default_factory=dict)
    """Frames of all cameras; a `Frame` has the terms `rgb`, `depth` and `cloud`."""

    @property
    def rgb(self) -> np.ndarray | None:
        """Picture (H, W, 3) uint8 sRGB of the first camera, or None."""
        return next((frame.rgb for frame in self.frames.values()), None)


@dataclass(frozen=True)
class PrivilegedObservation:
    """Values available only in a simulator."""

    contact: np.ndarray
    """Force on each fingertip (F, 3) float32 [N] in the base frame."""
    joint_velocities: np.ndarray
    """Speeds of the robot's joints (A,) float32 [rad/s]."""
    object_velocities: np.ndarray
    """Velocities of the objects' origins (O, 6) float32: linear [m/s], angular [rad/s], in the base frame."""
    displacement_velocities: np.ndarray
    """Speeds of the objects' joints (K,) float32 [rad/s or m/s]."""
    hand_poses: np.ndarray
    """Pose of every limb's palm (L, 7) float32 in the base frame."""
    hand_velocities: np.ndarray
    """Velocities of the palms (L, 6) float32: linear [m/s], angular [rad/s], in the base frame."""
    tip_poses: np.ndarray
    """Poses of the fingertips of all limbs (F, 7) float32 in the base frame."""
    tip_velocities: np.ndarray
    """Velocities of the fingertips (F, 6) float32: linear [m/s], angular [rad/s], in the base frame."""
    points: np.ndarray
    """Points on the surface of the task's object (P, 3) float32 [m] in the base frame."""


def deployable(measured: Measurement, previous_action: np.ndarray, goal: np.ndarray) -> DeployableObservation:
    """The observation of a policy from one measurement; the only way to make one at run time."""
    return DeployableObservation(
        previous_action=np.asarray(previous_action, np.float32),
        joints=np.asarray(measured.joints, np.float32),
        objects=np.asarray(measured.objects, np.float32),
        displacement=np.asarray(measured.displacement, np.float32),
        goal=np.array(goal, np.float32),
        frames=measured.frames,
    )
