"""background.robot without a renderer: no pixel shows the robot."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(summary="no robot in the picture", profiles=("stub",))


def mask(
    ctx: Context, robot: RobotModel, camera: Camera, base: np.ndarray, joints: dict[str, float], options: Options
) -> np.ndarray:
    """An empty mask (H, W)."""
    return np.zeros((camera.height, camera.width), bool)


def depth(
    ctx: Context, robot: RobotModel, camera: Camera, base: np.ndarray, joints: dict[str, float], options: Options
) -> np.ndarray:
    """Nothing, (H, W)."""
    return np.zeros((camera.height, camera.width))
