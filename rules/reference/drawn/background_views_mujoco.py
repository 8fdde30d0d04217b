"""reference.background_views with MuJoCo's renderer and the soft shadows of the photograph."""

from __future__ import annotations

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


def photograph(ctx: Context, world: World, supersample: int, soft: bool, options: Options) -> Shot:
    """Colours, depth [m] and object labels of the world's camera."""
    return worlds.photograph(world, None, supersample=supersample, soft=soft)
