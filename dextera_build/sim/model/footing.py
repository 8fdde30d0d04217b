"""What is below the underside of a body: the height of the surfaces under its corners, and whether they carry it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dextera_build.geometry.convex import Convex, thicken

UPRIGHT = 1e-9
"""Vertical part of a unit normal below which a face is upright."""


def floor(points: np.ndarray, pieces: Sequence[Convex], above_m: float) -> np.ndarray:
    """Height (N,) of the highest surface under each point (N, 3), at least that of the support [m].

    Args:
        points: Corners of an underside in the world [m].
        pieces: What may carry it.
        above_m: A surface may be this far above a point: shapes overlap slightly [m].
    """
    low, high = points.min(axis=0), points.max(axis=0)
    found = np.zeros(len(points))
    for piece in pieces:
        if (piece.low[:2] < high[:2]).all() and (piece.high[:2] > low[:2]).all():
            tops = _tops(piece, points)
            found = np.where(tops <= points[:, 2] + above_m, np.maximum(found, tops), found)
    return found


def carry(corners: np.ndarray, touching: np.ndarray) -> bool:
    """Whether the corners (N, 3) that touch something, (N,) bool, are on all sides of the middle of all of them."""
    towards = (corners[touching] - corners.mean(axis=0))[:, :2]
    angles = np.sort(np.arctan2(towards[:, 1], towards[:, 0]))
    return len(angles) > 2 and bool(np.diff(np.append(angles, angles[0] + 2 * np.pi)).max() < np.pi)


def _tops(piece: Convex, points: np.ndarray) -> np.ndarray:
    """Height (N,) of a piece's surface on the vertical line through each point (N, 3) [m]; -inf beside it."""
    from scipy.spatial import ConvexHull

    faces = np.unique(ConvexHull(thicken(piece.corners), qhull_options="Qt").equations.round(12), axis=0)
    room = -faces[:, 3:] - faces[:, :2] @ points[:, :2].T
    slope = np.where(np.abs(faces[:, 2:3]) < UPRIGHT, 0.0, faces[:, 2:3])
    with np.errstate(divide="ignore", invalid="ignore"):
        high = np.where(slope > 0, room / slope, np.inf).min(axis=0)
        low = np.where(slope < 0, room / slope, -np.inf).max(axis=0)
    beside = (np.where(slope == 0, room, 0.0) < 0).any(axis=0) | (low > high)
    return np.where(beside, -np.inf, high)
