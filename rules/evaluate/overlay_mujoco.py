"""evaluate.overlay rendered by MuJoCo."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.scene import Scene
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.model import model as models
from dextera_build.sim.render import rendering

BACKEND = Backend(summary="MuJoCo through EGL", profiles=("cpu",), packages=("mujoco",), extra="twin")

TURNS_DEG = (-50.0, 50.0)
"""Directions of the other two pictures, about the vertical from the photograph's."""


def render(ctx: Context, scene: Scene, options: Options) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, ...]]:
    """Colours (H, W, 3) uint8 through camera `capture`, its owner (H, W) int32 per pixel, and colours from two sides.

    The pictures are drawn as `mujoco.Renderer` draws them if it is told nothing else.
    """
    model = models.compile_folder(scene.model)
    data = models.at_home(model)
    names = (*scene.bodies, *scene.held)
    camera, pose = scene.camera, scene.camera_pose.matrix
    roots = [data.body(name).xpos for name in names]
    middle = np.mean(roots, axis=0) if roots else np.zeros(3)
    sides = (rendering.orbit(pose, middle, np.radians(turn)) for turn in TURNS_DEG)
    (pixels, *around), geoms = rendering.stock(model, data, ["capture", *sides], camera.height, camera.width)
    owner = rendering.owners_of(model, geoms, names)
    return pixels, owner, tuple(around)
