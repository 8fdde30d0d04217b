"""How uneven a support is: a bed, a crumpled blanket or a warped depth image is no plane."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.object import Support
from dextera_build.geometry import planes, regions, transforms

CELL_M = 0.03
"""Heights are averaged over squares of this edge, which leaves little of the depth camera's noise [m]."""
FEWEST = 20
"""Pixels of a square that counts."""
BAND_M = 0.04
"""What is farther from the plane is something else [m]."""
UNEVEN_M = 0.0035
"""Unevenness from which a support is doubted [m]: real tables had 0.8 to 2.6 mm at 0.5 to 1.6 m, one with warped depth
6.9 mm; a sag of 10 mm over half a metre has 3.6 mm, bumps of 5 mm have 4.7 mm, with noise or without."""
NOISES = 2.0
"""The same in standard deviations of the depth's noise, for supports that are far away."""


def unevenness(support: Support, points: np.ndarray, valid: np.ndarray) -> float:
    """Standard deviation of the support's height about its plane, without noise [m].

    It is that of a normal distribution with the median distance of the squares' mean heights, so that things on the
    support which cover less than about half of it do not count.

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
    """What is doubtful about the support's shape; empty if nothing is. The arguments are those of `unevenness`."""
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
    """Pixels (H, W) of the support and of what is lower than `BAND_M` on it."""
    placed = transforms.apply(support.camera_pose.matrix, points)
    inside = regions.inside_convex(placed[..., :2], support.polygon)
    return np.asarray(valid & inside & (np.abs(placed[..., 2]) < BAND_M))
