"""A robot is tried in a world that MuJoCo draws, coarsely."""

from __future__ import annotations

from dextera_build.artifacts.robot import RobotModel
from dextera_build.artifacts.world import World
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.worlds.tried import TriedWorld

BACKEND = Backend(
    summary="MuJoCo's OpenGL renderer (EGL, on the CPU or a GPU), at a quarter of the resolution",
    profiles=("cpu",),
    packages=("mujoco",),
    extra="twin",
)


def trial(ctx: Context, world: World, robot: RobotModel, options: Options) -> TriedWorld:
    """The world with the robot in it, whose base can be moved."""
    return TriedWorld(world, robot)
