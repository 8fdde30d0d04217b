"""Pixels of a robot in frames of a calibrated camera, from its model and its encoder readings."""

from __future__ import annotations

from typing import Any, Self

import mujoco
import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.geometry import robot_mask, transforms
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.model.model import compile_folder
from dextera_build.sim.render.rendering import Eye

TOLERANCE_M = 0.015
"""Maximum difference of measured and rendered depth on the robot [m]."""
UNDRAWN = 5
"""Group of geoms that are not drawn."""
GROW_PX = 4
"""Distance outside the rendered outline within which pixels may be the robot's [px], for calibration errors."""


class RobotPixels:
    """Renders only the robot of a twin; a context manager, because it holds a GL context.

    Args:
        twin: The task in the twin.
        camera: Intrinsics of the frames.
        camera_from_base: Calibrated T_camera_base (4, 4).
    """

    def __init__(self, twin: TaskBundle, camera: Camera, camera_from_base: np.ndarray) -> None:
        self._robot = twin.robot
        self._model = compile_folder(twin.model)
        names = [self._model.body(number).name for number in self._model.geom_bodyid]
        self._model.geom_group[[not name.startswith(ROBOT) for name in names]] = UNDRAWN
        self._data = mujoco.MjData(self._model)
        pose = twin.base_pose.matrix @ transforms.invert(camera_from_base)
        self._eye = Eye(self._model, camera, pose, samples=1)

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close the camera."""
        self._eye.__exit__(None, None, None)

    def mask(self, joints: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Pixels (H, W) bool of the robot.

        Args:
            joints: Positions (A,) in the robot's order [rad or m].
            depth: Measured depth (H, W) [m]; 0 where nothing was measured.
        """
        pose_robot(self._robot, self._data, joints)
        mujoco.mj_forward(self._model, self._data)
        drawn = self._eye.depth(self._data).astype(np.float64)
        labels = (drawn > 0).astype(np.int32)
        near = robot_mask.near(drawn, labels, depth, TOLERANCE_M, GROW_PX)
        return np.asarray((near > 0) | ((labels > 0) & (depth <= 0)))


def pose_robot(robot: RobotModel, data: Any, joints: np.ndarray) -> None:
    """Set the robot of a task's model to joint positions (A,) [rad or m], followers included."""
    read = zip((joint.name for joint in robot.joints), map(float, joints), strict=True)
    for name, place in robot.followed({**robot.home, **dict(read)}).items():
        data.joint(ROBOT + name).qpos[0] = place
