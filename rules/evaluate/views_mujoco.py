"""evaluate.views rendered by MuJoCo with its default flags."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.model import model as models
from dextera_build.sim.render import rendering

from .other_view import Own

BACKEND = Backend(summary="MuJoCo through EGL", profiles=("cpu",), packages=("mujoco",), extra="twin")


def draw(
    ctx: Context, scene: Scene, room: Room | None, own: Own, camera: Camera, moves: np.ndarray, options: Options
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Colours and depth of the scene's home keyframe."""
    model = models.compile_folder(scene.model)
    data = models.at_home(model)
    with rendering.Eye(model, camera, scene.camera_pose.matrix, shadows=True) as eye:
        for move in moves:
            eye.look_from(scene.camera_pose.matrix @ move)
            yield eye.rgb(data), eye.depth(data)
