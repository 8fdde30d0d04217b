"""Films of a rendered hand, for what looks for hands in pictures; no human hand was filmed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from dextera_build.geometry import hands

WIDTH, HEIGHT = 640, 480
SKIN = (0.82, 0.62, 0.50, 1.0)
RADII_M = ((0.014, 0.012, 0.0105), *((0.0115, 0.0095, 0.0085, 0.0075),) * 3, (0.0105, 0.008, 0.0072, 0.0065))
"""Of the bones of each finger, from the wrist on [m]."""
PALM = (0, 1, 2, 5, 6, 10, 11, 15, 16, 20, 21)
"""Joints within the palm."""
GREY = np.array([0.35, 0.45, 0.5, 1.0])


def film(path: Path, frames: Sequence[np.ndarray], view_deg: float, rate_hz: float) -> None:
    """Write a film of hands with joints (25, 3) in the camera's axes: x right, y down, z away [m]."""
    import cv2

    out = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), rate_hz, (WIDTH, HEIGHT))
    for points in frames:
        out.write(picture(points, view_deg)[..., ::-1])
    out.release()


def picture(points: np.ndarray, view_deg: float) -> np.ndarray:
    """A picture (HEIGHT, WIDTH, 3) uint8 of a hand."""
    # MuJoCo's cameras look along -z, with y up.
    model = _scene(points * [1.0, -1.0, -1.0], view_deg).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, HEIGHT, WIDTH) as renderer:
        renderer.update_scene(data, "eye")
        return np.array(renderer.render())


def _scene(points: np.ndarray, view_deg: float) -> Any:
    spec = mujoco.MjSpec()
    spec.visual.global_.offwidth, spec.visual.global_.offheight = WIDTH, HEIGHT
    world = spec.worldbody
    for chain, radii in zip(hands.CHAINS, RADII_M, strict=True):
        for one, other, radius in zip(chain, chain[1:], radii, strict=False):
            _bone(world, points[one], points[other], radius)
    across = points[hands.KNUCKLES[1]] - points[hands.KNUCKLES[4]]
    across /= np.linalg.norm(across)
    down = points[hands.WRIST] - points[hands.KNUCKLES[2]]
    down /= np.linalg.norm(down)
    thick = np.cross(across, down)
    corners = [points[joint] + 0.011 * sign * thick for joint in PALM for sign in (-1, 1)]
    corners += [points[0] + 0.026 * one * across + 0.017 * other * thick for one in (-1, 1) for other in (-1, 1)]
    palm = spec.add_mesh(name="palm")
    palm.uservert, palm.inertia = np.array(corners).ravel(), mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    world.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="palm", rgba=SKIN)
    _bone(world, points[0] + 0.03 * down, points[0] + 0.25 * down, 0.026)
    world.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[3, 3, 0.01], pos=[0, 0, -2], rgba=GREY)
    world.add_light(pos=[0.4, 0.6, 0.3], dir=[-0.3, -0.5, -1], diffuse=[0.6] * 3, castshadow=False)
    world.add_light(pos=[-0.6, 0.2, 0.4], dir=[0.5, -0.2, -1], diffuse=[0.3] * 3, castshadow=False)
    half = np.radians(view_deg) / 2
    world.add_camera(name="eye", fovy=float(np.degrees(2 * np.arctan(np.tan(half) * HEIGHT / WIDTH))))
    return spec


def _bone(world: Any, one: np.ndarray, other: np.ndarray, radius: float) -> None:
    world.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[*one, *other], size=[radius, 0, 0], rgba=SKIN)
