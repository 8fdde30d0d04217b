"""Unevenness of a support: a bed, a crumpled blanket or a warped depth image is not planar."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.objects.object import Support
from dextera_build.geometry import planes, regions, transforms

CELL_M = 0.03
"""Edge of the squares over which heights are averaged to reduce the depth camera's noise [m]."""
FEWEST = 20
"""Minimum number of pixels of a square."""
BAND_M = 0.04
"""Points farther from the plane are not part of the support [m]."""
UNEVEN_M = 0.0035
"""Unevenness above which a support is doubtful [m]: real tables had 0.8 to 2.6 mm at 0.5 to 1.6 m, one with warped
depth 6.9 mm; a sag of 10 mm over half a metre has 3.6 mm, bumps of 5 mm have 4.7 mm, with or without noise."""
NOISES = 2.0
"""The same in standard deviations of the depth noise, for distant supports."""


def unevenness(support: Support, points: np.ndarray, valid: np.ndarray) -> float:
    """Standard deviation of the support's height about its plane, without noise [m].

    It is that of a normal distribution with the median distance of the squares' mean heights, so that it is robust to
    objects that cover less than about half of the support.

    Args:
        support: Its plane and outline.
        points: (H, W, 3) of the picture that is upright like `support`, camera frame [m].
        valid: (H, W) bool, measured pixels.
    """
    placed = transforms.apply(support.camera_pose.matrix, points[_own(support, points, valid)])
    square = np.floor(placed[:, :2] / CELL_M).astype(np.int64)
    _, index, count = np.unique(square, axis=0, return_inverse=True, return_counts=True)
    mean = np.bincount(index.ravel(), placed[:, 2]) / count
    mean = mean[count >= FEWEST]
    return float(1.4826 * np.median(np.abs(mean))) if len(mean) else 0.0


def doubt(support: Support, points: np.ndarray, valid: np.ndarray) -> str:
    """Warning about the support's shape; empty if there is none. The arguments are those of `unevenness`."""
    found = unevenness(support, points, valid)
    noise = float(planes.depth_sigma(np.median(points[_own(support, points, valid)][:, 2]))) if found else 0.0
    if found <= max(UNEVEN_M, NOISES * noise):
        return ""
    rms = 1000.0 * (support.residual_m or 0.0)
    return (
        f"the support is not flat: its surface is {1000.0 * found:.1f} mm off the plane, {rms:.1f} mm rms where it is "
        "nearest; things on it may float or sink, and low ones may be missed: smooth it, or put a board on it"
    )


def _own(support: Support, points: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Pixels (H, W) of the support and of points up to `BAND_M` above it."""
    placed = transforms.apply(support.camera_pose.matrix, points)
    inside = regions.inside_convex(placed[..., :2], support.polygon)
    return np.asarray(valid & inside & (np.abs(placed[..., 2]) < BAND_M))
