"""Bounding boxes that are not aligned with the axes."""

from __future__ import annotations

import numpy as np


def upright_box(points: np.ndarray) -> tuple[np.ndarray, float]:
    """The upright box of least footprint area around points: its edges and its yaw.

    The least rectangle has a side along an edge of the convex hull (Freeman and Shapira 1975).

    Args:
        points: (N, 3) with z up [m], not all on one vertical line.

    Returns:
        Edge lengths (long, short, height) (3,) [m], and the angle of the long side to the x axis [rad].
    """
    from scipy.spatial import ConvexHull

    flat = np.asarray(points[:, :2], np.float64)
    corners = flat[ConvexHull(flat).vertices]
    sides = np.roll(corners, -1, axis=0) - corners
    angles = np.arctan2(sides[:, 1], sides[:, 0])
    along = corners @ np.stack([np.cos(angles), np.sin(angles)])
    across = corners @ np.stack([-np.sin(angles), np.cos(angles)])
    lengths, widths = np.ptp(along, axis=0), np.ptp(across, axis=0)
    best = int(np.argmin(lengths * widths))
    edges = sorted((float(lengths[best]), float(widths[best])), reverse=True)
    yaw = angles[best] + (0.0 if lengths[best] >= widths[best] else np.pi / 2)
    height = float(np.ptp(points[:, 2]))
    return np.array([*edges, height]), float(yaw)
