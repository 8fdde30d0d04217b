"""reference.truth: the true state of a reference world; accepted only by rules of stage `evaluate`."""

from __future__ import annotations

from typing import Any, Literal, Protocol

import numpy as np
from pydantic import PositiveInt

from dextera_build.artifacts.cameras.image import DepthImage, Image, LabelImage
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.scene import Truth, TruthObject
from dextera_build.artifacts.scenes.world import World
from dextera_build.rule import Context, Options, rule
from dextera_build.sim.render.shot import Shot

from . import solids


class TruthOptions(Options):
    """Options of reference.truth."""

    supersample: PositiveInt = 2
    """Samples per pixel edge of the colour render."""
    hidden: Literal["fail", "leave_out"] = "fail"
    """Treatment of objects without a visible pixel."""


class CameraBackend(Protocol):
    """Interface of a backend of reference.truth."""

    def photograph(self, ctx: Context, world: World, robot: RobotModel | None, supersample: int, options: Any) -> Shot:
        """Colours, depth [m] and object labels of the world's camera, without noise."""
        ...


@rule(version=1, packages=("numpy",), memory_gb=2.0)
def truth(
    ctx: Context[CameraBackend], world: World, robot: RobotModel | None = None, *, options: TruthOptions | None = None
) -> Truth:
    """Return posed surfaces in the frame `reference` [m], noise-free colours and depth, and labels of visible pixels.

    The backend offers `photograph(world, robot, supersample=...) -> Shot`, as for `reference.photograph`.
    """
    options = options or TruthOptions()
    shot = ctx.backend.photograph(ctx, world, robot, options.supersample, ctx.backend_options)
    objects = {
        name: TruthObject(mesh=solids.moved(thing.surface, thing.pose.matrix), label=label)
        for label, (name, thing) in enumerate(world.objects.items(), start=1)
    }
    seen = {name: int((shot.labels == known.label).sum()) for name, known in objects.items()}
    for name, pixels in seen.items():
        if pixels == 0 and options.hidden == "leave_out":
            del objects[name]
        else:
            ctx.check(pixels > 0, f"`{name}` is hidden from the camera", hint=f"move `objects.{name}.at_m`")
    ctx.say(", ".join(f"{name} {pixels:,} px" for name, pixels in seen.items()))
    rgb = np.asarray(np.round(np.clip(shot.rgb, 0, 1) * 255), np.uint8)
    ctx.preview(_tinted(rgb, shot.labels), "visible instances")
    return Truth(
        objects=objects,
        labels=LabelImage(labels=shot.labels),
        rgb=Image(pixels=rgb),
        depth=DepthImage(depth=shot.depth.astype(np.float32)),
        camera=world.camera,
        camera_pose=world.camera_pose,
    )


def _tinted(rgb: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Tint each instance of the picture with hues a golden angle apart."""
    hue = 2 * np.pi * 0.381966 * labels
    tint = 127.5 + 127.5 * np.stack([np.cos(hue), np.cos(hue - 2.094), np.cos(hue + 2.094)], axis=-1)
    mixed = np.where(labels[..., None] > 0, 0.5 * rgb + 0.5 * tint, 0.6 * rgb)
    return np.asarray(np.round(mixed), np.uint8)
