"""Which measured pixels are on a robot, by its rendered depth: within a tolerance of it, and grown over its outline."""

from __future__ import annotations

import numpy as np


def near(
    rendered: np.ndarray, labels: np.ndarray, measured: np.ndarray, tolerance_m: float, grow_px: int
) -> np.ndarray:
    """Labels (H, W) of measured pixels: of the rendered pixel that is nearest in the picture, if their depths agree.

    Args:
        rendered: (H, W) depth of the robot's model at its joint positions [m]; 0 beside it.
        labels: (H, W) int, what each rendered pixel is a part of; 0 beside the robot.
        measured: (H, W) depth [m]; 0 where nothing was measured.
        tolerance_m: Largest difference of both depths.
        grow_px: How far beyond the rendered outline a pixel may be; as far as the calibration may be wrong.
    """
    from scipy.ndimage import distance_transform_edt

    if not (labels > 0).any():
        return np.zeros_like(labels)
    distance, places = distance_transform_edt(labels == 0, return_indices=True)
    row, column = places
    agrees = (measured > 0) & (np.abs(measured - rendered[row, column]) <= tolerance_m)
    return np.where(agrees & (distance <= grow_px), labels[row, column], 0).astype(labels.dtype)


def inner(labels: np.ndarray, depth: np.ndarray, step: float = 0.01) -> np.ndarray:
    """Pixels (H, W) bool of a rendered robot whose four neighbours are of the same part and of nearly the same depth.

    At outlines a camera measures a mixture, and between two parts it is not clear which one was seen.
    """
    found = labels > 0
    for axis in (0, 1):
        for way in (1, -1):
            found &= np.roll(labels, way, axis) == labels
            found &= np.abs(np.roll(depth, way, axis) - depth) <= step * np.maximum(depth, 1e-9)
    found[[0, -1]] = False
    found[:, [0, -1]] = False
    return np.asarray(found)
