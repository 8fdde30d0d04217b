"""evaluate.views of the capture as points, a baseline without a twin."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.rule import Backend, Context, Options

from . import other_view

BACKEND = Backend(summary="baseline: the capture's measured pixels as points of one pixel", packages=("numpy",))


def draw(
    ctx: Context,
    scene: Scene,
    room: Room | None,
    own: other_view.Own,
    camera: Camera,
    moves: np.ndarray,
    options: Options,
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Colours and depth of the nearest point in each pixel."""
    for move in moves:
        yield other_view.splat(own, np.linalg.inv(move))
