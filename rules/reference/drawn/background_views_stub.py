"""reference.background_views with ray casting, without lights."""

from __future__ import annotations

from dextera_build.artifacts.scenes.world import World
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.render.shot import Shot

from ..unlit import unlit

BACKEND = Backend(summary="ray casting, no lights", profiles=("stub",), packages=("open3d",), extra="twin")


def photograph(ctx: Context, world: World, supersample: int, soft: bool, options: Options) -> Shot:
    """Unlit colours, depth [m] and object labels of the world's camera; `supersample` and `soft` are ignored."""
    return unlit(world)
