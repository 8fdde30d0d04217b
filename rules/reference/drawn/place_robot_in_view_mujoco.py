"""Robot poses evaluated in coarse renderings by MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.world import RobotStand, World
from dextera_build.geometry import transforms
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.model.forward import Kinematics
from dextera_build.sim.worlds.pose_trials import TriedWorld

BACKEND = Backend(
    summary="MuJoCo's OpenGL renderer (EGL, on the CPU or a GPU), at a quarter of the resolution",
    profiles=("cpu",),
    packages=("mujoco",),
    extra="twin",
)


def points(
    ctx: Context, world: World, robot: RobotModel, stands: list[RobotStand], options: Options
) -> list[np.ndarray]:
    """By forward kinematics of the robot alone."""
    kinematics, found = Kinematics(robot), []
    parts = [*(name for name in robot.links if name != "base"), *robot.frames]
    for stand in stands:
        kinematics.pose(stand.joints)
        places = np.array([kinematics.frame(part)[:3, 3] for part in parts])
        found.append(transforms.apply(stand.pose().matrix, places))
    return found


def sights(
    ctx: Context, world: World, robot: RobotModel, stands: list[RobotStand], options: Options
) -> Iterator[tuple[np.ndarray, float, float]]:
    """By segmentation renderings, made on demand."""
    tried = TriedWorld(world, robot)
    yield from map(tried.sight, stands)
