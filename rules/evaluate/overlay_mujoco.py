"""evaluate.overlay rendered by MuJoCo."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.model import model as models
from dextera_build.sim.render import framing, rendering

BACKEND = Backend(summary="MuJoCo through EGL", profiles=("cpu",), packages=("mujoco",), extra="twin")

SIDES = {"the left": (-50.0, None), "the right": (50.0, None), "behind": (180.0, None), "above": (0.0, 75.0)}
"""Side -> direction about the vertical relative to the photograph's, and pitch of the camera below the horizon
[deg]."""


def render(ctx: Context, scene: Scene, options: Options) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Colours (H, W, 3) uint8 through camera `capture`, its owner (H, W) int32 per pixel, and colours from other sides.

    The pictures are those of `mujoco.Renderer` with default settings.
    """
    model = models.compile_folder(scene.model)
    data = models.at_home(model)
    names = (*scene.bodies, *scene.held)
    camera, eye = scene.camera, scene.camera_pose.matrix[:3, 3]
    free = scene.bodies or tuple(scene.held)  # fixed bodies are part of the room, unless all bodies are fixed
    sides = [
        framing.around(
            model, data, free, eye, np.radians(turn), tilt and np.radians(tilt), camera.width / camera.height
        )
        for turn, tilt in SIDES.values()
    ]
    (pixels, *others), geoms = rendering.stock(model, data, ["capture", *sides], camera.height, camera.width)
    owner = rendering.owners_of(model, geoms, names)
    return pixels, owner, dict(zip(SIDES, others, strict=True))
