"""Planes of the room other than the support: walls, fronts of cupboards, worktops, shelves."""

from __future__ import annotations

import cv2
import numpy as np

from dextera_build.geometry import planes

MOST = 10
"""Maximum number of planes."""
SAMPLES = 3000
"""Number of points sampled for each plane."""
GATE = 2.5
"""Inliers are within this many standard deviations of the depth noise."""
UPRIGHT_DEG = 6.0
"""A plane nearer than this to vertical or horizontal is made so."""


def flats(points: np.ndarray, mask: np.ndarray, up: np.ndarray, least: float) -> list[tuple[planes.Plane, np.ndarray]]:
    """Planes, in the camera frame, with the pixels (H, W) bool of each, most pixels first.

    Args:
        points: (H, W, 3) in the camera frame [m].
        mask: (H, W) pixels to explain.
        up: (3,) upward direction in the camera frame.
        least: Minimum fraction of the picture that a plane covers.
    """
    rng = np.random.default_rng(0)
    rest, found = mask.copy(), []
    for _ in range(MOST):
        where = np.flatnonzero(rest)
        if len(where) < max(3, 1.5 * least * mask.size):
            break
        some = points.reshape(-1, 3)[rng.choice(where, min(SAMPLES, len(where)), replace=False)]
        plane = _upright(planes.ransac(some, _sigma(some[:, 2]), rng, gate=GATE), some, up)
        inside = _inside(plane, points, rest)
        if inside.sum() < least * mask.size:
            break
        found.append((planes.facing(plane), inside))
        rest &= ~inside
    return found


def _sigma(z: np.ndarray) -> np.ndarray:
    return np.asarray(planes.depth_sigma(z))


def _upright(plane: planes.Plane, points: np.ndarray, up: np.ndarray) -> planes.Plane:
    normal, offset = plane
    lean = float(normal @ up)
    if abs(lean) < np.sin(np.radians(UPRIGHT_DEG)):
        level = normal - lean * up
    elif abs(lean) > np.cos(np.radians(UPRIGHT_DEG)):
        level = up * np.sign(lean)
    else:
        return plane
    level = level / np.linalg.norm(level)
    near = np.abs(planes.distance(plane, points)) < GATE * _sigma(points[:, 2])
    return level, -float(np.median(points[near] @ level)) if near.any() else offset


def _inside(plane: planes.Plane, points: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Pixels in the plane, without specks and threads, with small gaps closed."""
    far = np.abs(planes.distance(plane, points))
    inside = (rest & (far < GATE * _sigma(points[..., 2]))).astype(np.uint8)
    side = max(3, rest.shape[1] // 120) | 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    inside = cv2.morphologyEx(cv2.morphologyEx(inside, cv2.MORPH_OPEN, disc), cv2.MORPH_CLOSE, disc)
    _count, labels, facts, _ = cv2.connectedComponentsWithStats(inside, connectivity=4)
    kept = facts[:, cv2.CC_STAT_AREA] >= 0.001 * rest.size
    kept[0] = False
    return np.asarray(kept[labels] & rest)
