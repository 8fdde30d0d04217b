"""Depth image of points as a camera would measure it."""

from __future__ import annotations

import numpy as np

from dextera_build.gaussians.fit.camera import FitCamera
from dextera_build.geometry import cameras, transforms

SAME = 0.03
"""A pixel deeper than the least depth around it by this relative difference shows a surface behind, between points."""


def seen_depth(points: np.ndarray, camera: FitCamera) -> np.ndarray:
    """Depth (H, W) [m] of the nearest point in each pixel; 0 if there is none, or only one behind a nearer surface."""
    rows, columns = camera.size
    local = transforms.apply(transforms.invert(camera.world_from_camera), points.astype(np.float64))
    row, column, inside = cameras.nearest_pixels(local, camera.k, camera.size, camera.near_m)
    nearest = np.full((rows, columns), np.inf)
    np.minimum.at(nearest, (row[inside], column[inside]), local[inside, 2])
    around = np.pad(nearest, 1, constant_values=np.inf)
    least = np.min([around[r : r + rows, c : c + columns] for r in range(3) for c in range(3)], axis=0)
    shown = np.isfinite(nearest) & (nearest <= (1 + SAME) * least)
    return np.asarray(np.where(shown, nearest, 0.0))
