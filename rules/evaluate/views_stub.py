"""evaluate.views without a renderer: grey pictures without a surface."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.rule import Backend, Context, Options

from .other_view import Own

BACKEND = Backend(summary="no rendering: grey pictures", profiles=("stub",))


def draw(
    ctx: Context, scene: Scene, room: Room | None, own: Own, camera: Camera, moves: np.ndarray, options: Options
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """A grey picture and an empty depth map for each view."""
    size = (camera.height, camera.width)
    for _ in moves:
        yield np.full((*size, 3), 128, np.uint8), np.zeros(size)
