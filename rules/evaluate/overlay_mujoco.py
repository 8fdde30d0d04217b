"""evaluate.overlay rendered by MuJoCo."""

from __future__ import annotations

import io

import numpy as np

from dextera_build.artifacts.scene import Scene
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.model import model as models
from dextera_build.sim.render import rendering

BACKEND = Backend(summary="MuJoCo through EGL", profiles=("cpu",), packages=("mujoco",), extra="twin")


def render(ctx: Context, scene: Scene, options: Options) -> tuple[np.ndarray, np.ndarray]:
    """Colours (H, W, 3) uint8 and, per pixel, its place in `bodies` and `held` (H, W) int32, or -1."""
    model = models.compile_folder(scene.model)
    data = models.at_home(model)
    with rendering.Eye(model, scene.camera, scene.camera_pose.matrix) as eye:
        pixels = eye.rgb(data)
        geoms = eye.segmentation(data)
    roots = np.append(np.asarray(model.body_rootid), -1)[rendering.bodies_of(model, geoms)]
    owner = np.full(geoms.shape, -1, np.int32)
    for number, name in enumerate((*scene.bodies, *scene.held)):
        owner[roots == model.body(name).id] = number
    return _backed(pixels, owner < 0, scene), owner


def _backed(pixels: np.ndarray, empty: np.ndarray, scene: Scene) -> np.ndarray:
    """Composite objects over the cleaned photograph, the static surface's texture seen from this camera."""
    from PIL import Image

    data = scene.model.files.get("assets/background.png")
    if data is None:
        return pixels
    behind = np.asarray(Image.open(io.BytesIO(data), formats=("PNG",)).convert("RGB"))
    return np.where(empty[..., None], behind, pixels) if behind.shape == pixels.shape else pixels
