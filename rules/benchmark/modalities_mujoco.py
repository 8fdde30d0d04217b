"""benchmark.modalities rendered by MuJoCo."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.model import model as models
from dextera_build.sim.render import rendering

BACKEND = Backend(summary="MuJoCo through EGL", profiles=("cpu",), packages=("mujoco",), extra="twin")


def render(ctx: Context, scene: Scene, options: Options) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Colours (H, W, 3) uint8 of `mujoco.Renderer`, owners (H, W) int32, and image-plane z (H, W) float32 [m]."""
    model = models.compile_folder(scene.model)
    data = models.at_home(model)
    camera = scene.camera
    (pixels,), geoms = rendering.stock(model, data, ["capture"], camera.height, camera.width)
    owner = rendering.owners_of(model, geoms, (*scene.bodies, *scene.held))
    return pixels, owner, rendering.render_depth(model, data, camera, scene.camera_pose.matrix)
