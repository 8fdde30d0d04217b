"""Ground truth by ray casting, without lights and robot: fast, and without a GL context."""

from __future__ import annotations

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.world import World
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.render.shot import Shot

from .unlit import unlit

BACKEND = Backend(
    summary="ray casting, no lights, no robot",
    profiles=("stub",),
    packages=("open3d",),
    extra="twin",
)


def photograph(ctx: Context, world: World, robot: RobotModel | None, supersample: int, options: Options) -> Shot:
    """Unlit colours, depth [m] and object labels through the world's camera; `supersample` is ignored."""
    return unlit(world)
