"""Intersections of camera rays with the support."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.geometry import cameras


def plane_depth(camera: Camera, world_from_camera: np.ndarray) -> np.ndarray:
    """Depth (H, W) [m] at which each pixel's ray meets z = 0 of the world; infinite without an intersection."""
    rays = cameras.rays(camera.height, camera.width, camera.matrix())
    down = rays @ world_from_camera[2, :3]
    with np.errstate(divide="ignore"):
        depth = -world_from_camera[2, 3] / down
    return np.where((down < -1e-9) & (depth > 0), depth, np.inf)
