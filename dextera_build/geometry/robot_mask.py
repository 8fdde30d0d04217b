"""Measured pixels on a robot, by comparison with its rendered depth, including a margin around its outline."""

from __future__ import annotations

import numpy as np


def near(
    rendered: np.ndarray, labels: np.ndarray, measured: np.ndarray, tolerance_m: float, grow_px: int
) -> np.ndarray:
    """Labels (H, W) of measured pixels: that of the nearest rendered pixel in the picture, if their depths agree.

    Args:
        rendered: (H, W) depth of the robot's model at its joint positions [m]; 0 outside it.
        labels: (H, W) int, part of each rendered pixel; 0 outside the robot.
        measured: (H, W) depth [m]; 0 where nothing was measured.
        tolerance_m: Largest difference of both depths.
        grow_px: Maximum distance of a pixel outside the rendered outline, for calibration errors.
    """
    from scipy.ndimage import distance_transform_edt

    if not (labels > 0).any():
        return np.zeros_like(labels)
    distance, places = distance_transform_edt(labels == 0, return_indices=True)
    row, column = places
    agrees = (measured > 0) & (np.abs(measured - rendered[row, column]) <= tolerance_m)
    return np.where(agrees & (distance <= grow_px), labels[row, column], 0).astype(labels.dtype)


def inner(labels: np.ndarray, depth: np.ndarray, step: float = 0.01) -> np.ndarray:
    """Pixels (H, W) bool of a rendered robot whose four neighbours have the same part and nearly the same depth.

    At outlines a camera measures mixed depth, and between two parts the assignment is ambiguous.
    """
    found = labels > 0
    for axis in (0, 1):
        for way in (1, -1):
            found &= np.roll(labels, way, axis) == labels
            found &= np.abs(np.roll(depth, way, axis) - depth) <= step * np.maximum(depth, 1e-9)
    found[[0, -1]] = False
    found[:, [0, -1]] = False
    return np.asarray(found)
