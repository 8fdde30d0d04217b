"""benchmark.modalities without a renderer: grey pictures without objects and depth."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(summary="no rendering: grey pictures", profiles=("stub",))


def render(ctx: Context, scene: Scene, options: Options) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Grey colours of the camera's size, no objects, no depth."""
    size = (scene.camera.height, scene.camera.width)
    return np.full((*size, 3), 128, np.uint8), np.full(size, -1, np.int32), np.zeros(size, np.float32)
