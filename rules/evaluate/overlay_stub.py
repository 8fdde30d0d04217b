"""evaluate.overlay without a renderer: a grey picture without objects."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.scene import Scene
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(summary="no rendering: a grey picture", profiles=("stub",))


def render(ctx: Context, scene: Scene, options: Options) -> tuple[np.ndarray, np.ndarray]:
    """A grey image of the camera's size, without objects."""
    size = (scene.camera.height, scene.camera.width)
    return np.full((*size, 3), 128, np.uint8), np.full(size, -1, np.int32)
