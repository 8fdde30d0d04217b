"""evaluate.views of the capture as one continuous mesh, a baseline without a twin."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.geometry import raycast
from dextera_build.rule import Backend, Context, Options

from . import other_view

BACKEND = Backend(
    summary="baseline: the capture's measured pixels as one mesh that joins all neighbours",
    packages=("numpy", "open3d"),
    extra="twin",
)


def draw(
    ctx: Context,
    scene: Scene,
    room: Room | None,
    own: other_view.Own,
    camera: Camera,
    moves: np.ndarray,
    options: Options,
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Colours and depth of the mesh, by ray casting."""
    surface = other_view.sheet(own)
    for move in moves:
        seen = raycast.render([surface], own.k, move, camera.height, camera.width)
        yield raycast.shade([surface], seen), seen.depth
