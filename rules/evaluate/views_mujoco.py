"""evaluate.views drawn by MuJoCo with its default flags."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.scene import Scene
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.model import model as models
from dextera_build.sim.render import rendering

BACKEND = Backend(summary="MuJoCo through EGL", profiles=("cpu",), packages=("mujoco",), extra="twin")


def draw(
    ctx: Context, scene: Scene, camera: Camera, poses: np.ndarray, options: Options
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Colours and depth of the scene's home keyframe from each of `poses` (N, 4, 4), T_world_camera."""
    model = models.compile_folder(scene.model)
    data = models.at_home(model)
    with rendering.Eye(model, camera, poses[0], shadows=True) as eye:
        for pose in poses:
            eye.look_from(pose)
            yield eye.rgb(data), eye.depth(data)
