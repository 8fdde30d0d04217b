"""evaluate.overlay without a renderer: a grey picture without objects."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(summary="no rendering: a grey picture", profiles=("stub",))


def render(ctx: Context, scene: Scene, options: Options) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Grey images of the camera's size, without objects."""
    size = (scene.camera.height, scene.camera.width)
    grey = np.full((*size, 3), 128, np.uint8)
    return grey, np.full(size, -1, np.int32), dict.fromkeys(("the left", "the right", "behind", "above"), grey)
