"""Presentation pictures of tasks and robots."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.geometry import cameras
from dextera_build.sim.model import model as models
from dextera_build.sim.model import robot as robots
from dextera_build.sim.model.sizes import FREE, HINGE
from dextera_build.sim.render.rendering import render_rgb

EYE = (0.35, -1.35, 0.95)
"""Camera position relative to the centre of the scene [m]."""


def portrait(model: Any, data: Any, width: int = 480, height: int = 360) -> np.ndarray:
    """Render the current scene, (height, width, 3) uint8, centred on robot and movable objects."""
    return render_rgb(model, data, *stand(model, data, width, height), shadows=False)


def at_home(bundle: TaskBundle) -> list[tuple[str, np.ndarray]]:
    """The kind of a task's world, and a picture of it from the camera of the photograph."""
    model = models.compile_folder(bundle.model)
    return [(bundle.kind, portrait(model, models.at_home(model)))]


def stand(model: Any, data: Any, width: int, height: int) -> tuple[Camera, np.ndarray]:
    """A camera and its T_world_camera with the robot and all movable objects in view."""
    free = [
        data.xpos[model.jnt_bodyid[joint]] for joint in range(model.njnt) if int(model.jnt_type[joint]) in (FREE, HINGE)
    ]
    points = np.array(free) if free else np.zeros((1, 3))
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    pose = cameras.look_at(middle + np.array(EYE), middle)
    focal = 1.05 * width
    camera = Camera(width=width, height=height, fx=focal, fy=focal, cx=(width - 1) / 2, cy=(height - 1) / 2)
    return camera, pose


def of_robot(
    robot: Folder,
    joints: Mapping[str, float],
    size: int = 480,
    around: tuple[Collection[str], np.ndarray] | None = None,
) -> np.ndarray:
    """Render the robot at `joints` [rad] from its front left, (size, size, 3) uint8.

    Args:
        robot: Its model.
        joints: Joint -> position [rad]; other joints are at 0.
        size: Edge of the picture [px].
        around: Links that alone are drawn, and the direction (3,) from them to the viewer; None: the whole robot.
    """
    spec = robots.load(robot)
    light = [-0.5, -0.4, -1] if around is None else list(-around[1])
    spec.worldbody.add_light(type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, dir=light, pos=[2, 2, 3], diffuse=[0.6] * 3)
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.86, 0.88, 0.9],
        rgb2=[0.7, 0.72, 0.75],
        width=32,
        height=192,
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    for name, position in joints.items():
        data.joint(name).qpos[0] = position
    mujoco.mj_forward(model, data)
    shown = np.ones(model.ngeom, bool)
    if around is not None:
        shown = np.isin(model.geom_bodyid, [model.body(name).id for name in around[0]])
        model.geom_group[~shown] = robots.CONTACT_GROUP
    places = data.geom_xpos[shown]
    middle = (places.min(axis=0) + places.max(axis=0)) / 2
    reach = float(np.linalg.norm(places - middle, axis=1).max()) + (0.1 if around is None else 0.02)
    aside = np.array([0.75, 0.55, 0.35]) if around is None else around[1]
    pose = cameras.look_at(middle + aside / np.linalg.norm(aside) * reach * 2.6, middle)
    half = (size - 1) / 2
    camera = Camera(width=size, height=size, fx=size * 1.2, fy=size * 1.2, cx=half, cy=half)
    return render_rgb(model, data, camera, pose, shadows=True)
