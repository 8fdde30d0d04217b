"""Collision boxes of the static scene."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.scenes.scene import SupportBox
from dextera_build.geometry import lie, regions


def support_box(polygon: np.ndarray, margin: float, thickness: float) -> SupportBox:
    """The smallest upright box under a polygon, with its top at z = 0.

    Args:
        polygon: (P, 2) outline in the world frame [m].
        margin: Extension of the box beyond the outline [m].
        thickness: Height of the box [m].
    """
    hull = regions.convex_hull(polygon)
    best: tuple[float, float, np.ndarray, np.ndarray] | None = None
    # One side of the smallest enclosing rectangle lies on an edge of the hull (Freeman and Shapira 1975).
    for edge in np.roll(hull, -1, axis=0) - hull:
        # Take the quarter turn nearest to the axes: an axis-aligned table gets yaw 0, not 90 degrees.
        yaw = (np.arctan2(edge[1], edge[0]) + np.pi / 4) % (np.pi / 2) - np.pi / 4
        axes = lie.about_z(-yaw)[:2, :2]
        local = hull @ axes.T
        low, high = local.min(axis=0), local.max(axis=0)
        size = float(np.prod(high - low))
        if best is None or size < best[0]:
            best = size, float(yaw), (low + high) / 2 @ axes, (high - low) / 2
    assert best is not None
    _, yaw, middle, half = best
    return SupportBox(
        name="support",
        centre=(float(middle[0]), float(middle[1]), -thickness / 2),
        half_size=(float(half[0]) + margin, float(half[1]) + margin, thickness / 2),
        yaw=float(yaw),
    )
