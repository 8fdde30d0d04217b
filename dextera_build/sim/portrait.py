"""Pictures of a task for people: from in front of the table, with shadows off."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.task import TaskBundle
from dextera_build.geometry import cameras
from dextera_build.sim import model as models
from dextera_build.sim.rendering import render_rgb

EYE = (0.35, -1.35, 0.95)
"""Where pictures are taken from, relative to the middle of the scene [m]."""


def portrait(model: Any, data: Any, width: int = 480, height: int = 360) -> np.ndarray:
    """The scene as it stands now, (height, width, 3) uint8: robot and movable objects in the middle."""
    return render_rgb(model, data, *stand(model, data, width, height), shadows=False)


def at_home(bundle: TaskBundle) -> list[tuple[str, np.ndarray]]:
    """What kind of world a task's is, and a picture of it as it was photographed."""
    model = models.compile_folder(bundle.model)
    return [(bundle.kind, portrait(model, models.at_home(model)))]


def stand(model: Any, data: Any, width: int, height: int) -> tuple[Camera, np.ndarray]:
    """A camera and its T_world_camera that see the robot and everything that can move."""
    free = [
        data.xpos[model.jnt_bodyid[joint]]
        for joint in range(model.njnt)
        if model.jnt_type[joint] in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_HINGE)
    ]
    points = np.array(free) if free else np.zeros((1, 3))
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    pose = cameras.look_at(middle + np.array(EYE), middle)
    focal = 1.05 * width
    camera = Camera(width=width, height=height, fx=focal, fy=focal, cx=(width - 1) / 2, cy=(height - 1) / 2)
    return camera, pose
