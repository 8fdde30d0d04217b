"""simulate.view: the camera that policies and films look through."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import PositiveInt

from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.scene import Scene
from dextera_build.artifacts.task import View
from dextera_build.geometry import cameras, transforms
from dextera_build.rule import Context, Options, rule

Point = tuple[float, float, float]


class ViewOptions(Options):
    """Options of simulate.view."""

    width_px: PositiveInt = 128
    """Width of a frame [px]."""
    height_px: PositiveInt = 96
    """Height of a frame [px]."""
    eye_m: Point | None = None
    """Where the camera stands in the world [m]; absent: where the photograph was taken."""
    target_m: Point | None = None
    """Target of a camera at `eye_m`, in the world [m]; image right is horizontal."""
    samples: Literal[1, 2, 4, 8] = 1
    """Samples per pixel: with four, edges are smooth, and a frame takes more than twice as long to render."""
    shift_m: Point = (0.0, 0.0, 0.0)
    """Then moved by this in the world, without turning [m]: a camera that was bumped."""


@rule(version=1, packages=("numpy",))
def view(ctx: Context, scene: Scene, *, options: ViewOptions) -> View:
    """Return the photograph's camera at another size, cropped evenly to the new shape, or one put elsewhere."""
    if (options.eye_m is None) != (options.target_m is None):
        ctx.fail("`eye_m` and `target_m` go together", eye_m=options.eye_m, target_m=options.target_m)
    camera = scaled(scene.camera, options.width_px, options.height_px)
    pose = scene.world_from_camera
    if options.eye_m is not None and options.target_m is not None:
        pose = cameras.look_at(np.array(options.eye_m), np.array(options.target_m))
    if any(options.shift_m):
        pose = transforms.rigid(pose[:3, :3], pose[:3, 3] + options.shift_m)
    ctx.say(f"{camera.width} x {camera.height} px, {'as photographed' if options.eye_m is None else 'placed by hand'}")
    return View(camera=camera, world_from_camera=pose, samples=options.samples)


def scaled(camera: Camera, width: int, height: int) -> Camera:
    """`camera` cropped evenly on two sides to the shape `width` : `height`, then scaled to that size [px].

    Pixel centres are integers, so the left border of the picture lies at -0.5 before and after.
    """
    scale = max(width / camera.width, height / camera.height)
    left, top = (camera.width - width / scale) / 2, (camera.height - height / scale) / 2
    return Camera(
        width=width,
        height=height,
        fx=camera.fx * scale,
        fy=camera.fy * scale,
        cx=(camera.cx + 0.5 - left) * scale - 0.5,
        cy=(camera.cy + 0.5 - top) * scale - 0.5,
    )
