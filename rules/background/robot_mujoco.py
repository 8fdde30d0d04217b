"""background.robot: the robot's model, rendered by MuJoCo."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import transforms
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.model import robot as robots
from dextera_build.sim.render import rendering

BACKEND = Backend(summary="MuJoCo through EGL", profiles=("cpu",), packages=("mujoco",), extra="twin")


def mask(
    ctx: Context, robot: RobotModel, camera: Camera, base: np.ndarray, joints: dict[str, float], options: Options
) -> np.ndarray:
    """Pixels (H, W) bool of the robot at `joints` [rad], its base at T_camera_base (4, 4)."""
    model, data, pose = _posed(robot, base, joints)
    return np.asarray(rendering.render_segmentation(model, data, camera, pose) >= 0)


def depth(
    ctx: Context, robot: RobotModel, camera: Camera, base: np.ndarray, joints: dict[str, float], options: Options
) -> np.ndarray:
    """Depth (H, W) float64 of the same [m]; 0 outside the robot."""
    model, data, pose = _posed(robot, base, joints)
    return rendering.render_depth(model, data, camera, pose).astype(np.float64)


def _posed(robot: RobotModel, base: np.ndarray, joints: dict[str, float]) -> tuple[Any, Any, np.ndarray]:
    """Model, state, and the camera's pose (4, 4) in the model's world."""
    model = robots.load(robot.model).compile()
    data = mujoco.MjData(model)
    for name, position in robot.followed(joints).items():
        data.joint(name).qpos[0] = position
    mujoco.mj_forward(model, data)
    # The robot's model has its base at the origin, so the camera moves instead.
    root = transforms.rigid(data.body("base").xmat.reshape(3, 3), data.body("base").xpos)
    return model, data, root @ np.linalg.inv(base)
