"""A robot is tried in a world that MuJoCo draws, coarsely."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dextera_build.artifacts.robot import RobotModel
from dextera_build.artifacts.world import RobotStand, World
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.worlds.tried import TriedWorld

BACKEND = Backend(
    summary="MuJoCo's OpenGL renderer (EGL, on the CPU or a GPU), at a quarter of the resolution",
    profiles=("cpu",),
    packages=("mujoco",),
    extra="twin",
)


def points(
    ctx: Context, world: World, robot: RobotModel, stands: list[RobotStand], options: Options
) -> list[np.ndarray]:
    """By forward kinematics."""
    tried = TriedWorld(world, robot)
    return [tried.points(stand) for stand in stands]


def sights(
    ctx: Context, world: World, robot: RobotModel, stands: list[RobotStand], options: Options
) -> Iterator[tuple[np.ndarray, float, float]]:
    """By segmentations, one when it is asked for."""
    tried = TriedWorld(world, robot)
    yield from map(tried.sight, stands)
