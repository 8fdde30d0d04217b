"""The upright box through the seen points of a thing, whatever smears its edges or breaks its faces."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import planes

from .round_forms import thinned

FEWEST = 120
"""Fewest points that tell."""
ANGLES = 45
"""Directions of the sides that are tried, over 90 deg."""
NEAR, NOISE = 0.05, 2.0
"""Largest distance of a point on a face from it: this part of the smaller side, or so many standard deviations of the
depth."""
SHARE = 0.85
"""Smallest fraction of the points below the top that are on a wall."""
LOWER = 0.05
"""Smallest fraction of the points below the top by which walls are judged."""
FILLED, FILLED_ALONE = 0.86, 0.93
"""Smallest part of the rectangle about the points that they fill from above, with walls in view and without."""


def is_box(points: np.ndarray, eye: np.ndarray) -> bool:
    """Whether points (N, 3), z up [m], seen from `eye` (3,), are on the top and the walls of an upright box."""
    import cv2

    if len(points) < FEWEST:
        return False
    points = thinned(points)
    noise = NOISE * float(planes.depth_sigma(np.asarray(np.linalg.norm(points.mean(axis=0) - eye))))
    top = float(np.quantile(points[:, 2], 0.98))
    best, lower = 0.0, False
    for angle in np.linspace(0.0, np.pi / 2, ANGLES, endpoint=False):
        flat = points[:, :2] @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        low, high = np.quantile(flat, [0.01, 0.99], axis=0)
        near = max(noise, NEAR * float((high - low).min()))
        wall = (np.minimum(np.abs(flat - low), np.abs(flat - high)) < near).any(axis=1)
        below = points[:, 2] <= top - near
        if below.mean() > LOWER:
            lower, best = True, max(best, float(wall[below].mean()))
    hull = cv2.convexHull(points[:, :2].astype(np.float32))
    sides = cv2.minAreaRect(hull)[1]
    filled = float(cv2.contourArea(hull)) / max(sides[0] * sides[1], 1e-12)
    return filled > FILLED and best > SHARE if lower else filled > FILLED_ALONE
