"""Photographs by MuJoCo's renderer, with shadows."""

from __future__ import annotations

from dextera_build.artifacts.robot import RobotModel
from dextera_build.artifacts.world import World
from dextera_build.rule import Backend
from dextera_build.sim import world as worlds
from dextera_build.sim.shot import Shot

BACKEND = Backend(
    summary="MuJoCo's OpenGL renderer, through EGL on the CPU or a GPU",
    profiles=("cpu",),
    packages=("mujoco",),
    extra="twin",
)


def photograph(world: World, robot: RobotModel | None, *, supersample: int) -> Shot:
    """Colours with shadows, depth [m] and object labels through the world's camera."""
    return worlds.photograph(world, robot, supersample=supersample, shadows=True)
