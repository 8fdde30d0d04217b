"""Cameras around the objects of a scene, each far enough away to see all of them, and inside the room."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

FILL = 0.85
"""Fraction of the picture's width and height that the objects may fill."""
WITHIN = 0.95
"""Fraction of the distance to a wall at which a camera is placed if it would be behind the wall."""
SHOWN = 3
"""Geoms of this group and above are hidden by default."""


def around(
    model: Any, data: Any, names: Sequence[str], eye: np.ndarray, turn: float, tilt: float | None, aspect: float
) -> Any:
    """An `mjvCamera` that sees all named objects with the field of view of the model's free camera.

    Args:
        model: Compiled model.
        data: A state after `mj_forward`.
        names: Root bodies of the objects; with none, the camera looks at the origin.
        eye: Position of another camera (3,), the reference of directions [m].
        turn: Direction about the vertical, from that of the other camera [rad].
        tilt: Pitch below the horizon [rad]; None: that of the other camera.
        aspect: Width of the picture over its height.
    """
    corners = _corners(model, data, names)
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    away = eye - middle
    azimuth = float(np.arctan2(-away[1], -away[0])) + turn
    elevation = -(float(np.arcsin(away[2] / np.linalg.norm(away))) if tilt is None else tilt)
    ahead = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
    up = np.cross(right, ahead)
    tangent = FILL * np.tan(np.radians(model.vis.global_.fovy) / 2.0)
    rest = corners - middle
    needed = np.maximum(np.abs(rest @ right) / (aspect * tangent), np.abs(rest @ up) / tangent) - rest @ ahead
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.lookat[:] = middle
    camera.azimuth, camera.elevation = np.degrees(azimuth), np.degrees(elevation)
    camera.distance = min(float(needed.max()), WITHIN * _to_a_wall(model, data, middle, -ahead))
    return camera


def _corners(model: Any, data: Any, names: Sequence[str]) -> np.ndarray:
    """Corners (N, 3) of the boxes around all geoms of the objects, world [m]."""
    roots = {model.body(name).id for name in names}
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    found = [np.zeros((1, 3))] if not roots else []
    for geom in range(model.ngeom):
        if model.body_rootid[model.geom_bodyid[geom]] in roots:
            centre, half = model.geom_aabb[geom][:3], model.geom_aabb[geom][3:]
            found.append(data.geom_xpos[geom] + (centre + signs * half) @ data.geom_xmat[geom].reshape(3, 3).T)
    return np.concatenate(found)


def _to_a_wall(model: Any, data: Any, start: np.ndarray, direction: np.ndarray) -> float:
    """Distance from a point (3,) to the nearest visible static surface in a direction (3,) [m]; inf without one."""
    nearest = np.inf
    for geom in range(model.ngeom):
        if model.body_rootid[model.geom_bodyid[geom]] != 0 or model.geom_group[geom] >= SHOWN:
            continue
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            distance = mujoco.mj_rayMesh(model, data, geom, start, direction)
        else:
            place, turn, size = data.geom_xpos[geom], data.geom_xmat[geom], model.geom_size[geom]
            distance = mujoco.mju_rayGeom(place, turn, size, start, direction, model.geom_type[geom])
        nearest = min(nearest, distance if distance >= 0.0 else np.inf)
    return float(nearest)
