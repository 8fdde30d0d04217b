"""evaluate.room without a renderer: a grey picture."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(summary="no rendering: a grey picture", profiles=("stub",))


def render(
    ctx: Context, scene: Scene, room: Splats, camera: Camera, world_from_camera: np.ndarray, options: Options
) -> np.ndarray:
    """A grey picture of the camera's size."""
    return np.full((camera.height, camera.width, 3), 128, np.uint8)
