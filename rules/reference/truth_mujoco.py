"""Ground truth from the photograph's renderer."""

from __future__ import annotations

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.world import World
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.render.shot import Shot
from dextera_build.sim.worlds import world as worlds

BACKEND = Backend(
    summary="MuJoCo's OpenGL renderer (EGL, on the CPU or a GPU), shadows by ray casting",
    profiles=("cpu",),
    packages=("mujoco", "open3d"),
    extra="twin",
)


def photograph(ctx: Context, world: World, robot: RobotModel | None, supersample: int, options: Options) -> Shot:
    """Colours with soft shadows, depth [m] and object labels through the world's camera."""
    return worlds.photograph(world, robot, supersample=supersample, soft=True)
