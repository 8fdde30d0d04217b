"""evaluate.room with objects rendered by MuJoCo, composed with the Gaussians by depth."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.model import model as models
from dextera_build.sim.render import composition

BACKEND = Backend(
    summary="MuJoCo through EGL, composed with the Gaussians by depth",
    profiles=("cpu",),
    packages=("mujoco", "numpy"),
    extra="twin",
)


def render(
    ctx: Context, scene: Scene, room: Splats, camera: Camera, world_from_camera: np.ndarray, options: Options
) -> np.ndarray:
    """The objects of the scene in keyframe `home` among the Gaussians, (H, W, 3) uint8 sRGB."""
    model = models.compile_folder(scene.model)
    bodies = composition.drawn(model, models.at_home(model), scene.bodies, camera, world_from_camera)
    return composition.among(bodies, room.gaussians, camera, world_from_camera)
