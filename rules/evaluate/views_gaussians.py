"""evaluate.views of the room as Gaussians by the rasteriser in Warp, with objects rendered by MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.gaussians.fit.camera import FitCamera
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.model import model as models
from dextera_build.sim.render import composition

from .other_view import Own

BACKEND = Backend(
    summary="Gaussians by NVIDIA Warp, objects by MuJoCo, composed by depth",
    packages=("mujoco", "numpy", "torch", "warp-lang"),
    extra="warp",
)

SOLID = 0.5
"""Transmittance below which a pixel has a surface."""


def draw(
    ctx: Context, scene: Scene, room: Room | None, own: Own, camera: Camera, moves: np.ndarray, options: Options
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Colours and expected depth of the Gaussians of `room`, with the scene's objects."""
    # Imported here, so that options can be read where Warp is not installed.
    import torch
    import warp as wp

    from dextera_build.gaussians.fit.parameters import opened
    from dextera_build.gaussians.rasteriser.raster import Parameters, Rasteriser

    if room is None:
        ctx.fail("there are no Gaussians to draw", hint="give `room`, the output of background.compose")
    given = room.splats.gaussians
    degree = round(np.sqrt(given.harmonics.shape[1])) - 1
    tensors = opened(given, "cpu", degree)
    maker = Rasteriser("cpu")
    kinds = (wp.vec3, wp.vec4, wp.vec3, wp.float32, wp.vec3)
    arrays = Parameters(*(wp.from_torch(each, dtype=kind) for each, kind in zip(tensors, kinds, strict=True)))
    model = models.compile_folder(scene.model)
    data = models.at_home(model)
    size = (camera.height, camera.width)
    for move in moves:
        pose = scene.camera_pose.matrix @ move
        bodies = composition.drawn(model, data, (*scene.bodies, *scene.held), camera, pose)
        limits = wp.from_torch(torch.tensor(bodies.depth_m.reshape(-1), dtype=torch.float32))
        picture = maker.forward(arrays, FitCamera(camera.matrix(), pose, size), limits)
        light = picture.light.numpy().reshape(size)
        there = (bodies.owner >= 0)[..., None]
        colour = picture.colour.numpy().reshape(*size, 3) + np.where(there, light[..., None] * bodies.rgb / 255.0, 0.0)
        depth = picture.depth.numpy().reshape(size) / np.maximum(1.0 - light, 1e-6)
        behind = np.where(np.isfinite(bodies.depth_m), bodies.depth_m, 0.0)
        yield np.round(255 * colour.clip(0, 1)).astype(np.uint8), np.where(light < SOLID, depth, behind)
