"""simulate.steady with MuJoCo."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.worlds import hold_unstable as runner

from .settle_mujoco import rests

if TYPE_CHECKING:
    from .steady import SteadyOptions

BACKEND = Backend(
    summary="MuJoCo, implicit integration, from keyframe `home`, until all free bodies rest",
    profiles=("cpu",),
    packages=("mujoco",),
    extra="twin",
)
CUT = ", and the border of the picture cuts it"
"""Part of the cause of a body whose shape is completed outside the picture."""


def hold(ctx: Context, scene: Scene, common: SteadyOptions, options: Options) -> tuple[Scene, list[str]]:
    """Simulate the scene and fix bodies that violate the limits in `common`."""
    found = runner.steady(scene.model, scene.bodies, common.seconds, lambda motion: rests(motion, common))
    free = tuple(name for name in scene.bodies if name not in found.held)
    causes = {name: why + (CUT if name in scene.cut else "") for name, why in found.held.items()}
    held = {**scene.held, **causes}
    done = [f"{name} is held where the photograph has it: {why}" for name, why in causes.items()]
    for (one, other), depth in found.apart.items():
        if not found.held.keys() & {one, other}:
            done.append(f"{one} and {other} do not collide: their shapes overlap by {1000 * depth:.1f} mm")
    return scene.model_copy(update={"model": found.scene, "bodies": free, "held": held}), done
