"""Starting parameters for fitting two hinged slabs: each large plane may be the lid."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..shapes.families import panels
from ..shapes.families.planes import largest_plane

MOST = 4000
"""Maximum number of points used."""
PLANES = 3
"""Number of planes that are tried as the lid."""
NEAR_M = 0.006
"""Largest distance of a plane's points [m]."""
LEAST_SHARE = 0.06
"""Smallest fraction of the seen points on a plane that may be the lid."""
LEAST_TILT = 0.05
"""Smallest horizontal component of the lid's normal: a more level lid does not determine a hinge (3 deg)."""
LEAST_M = 0.03
"""Minimum length and width of a lid [m]."""


def starts(points: np.ndarray) -> Iterator[np.ndarray]:
    """Starting parameters of `panels`: each large plane as the lid, on either side of the base, at two heights.

    Args:
        points: (N, 3) seen points in the world [m].
    """
    points = points[:: max(1, len(points) // MOST)]
    for normal, mine in _planes(points):
        tilt = float(np.linalg.norm(normal[:2]))
        if tilt < LEAST_TILT:
            continue
        lid, rest = points[mine], points[~mine]
        heights = [float(np.quantile(lid[:, 2], 0.01))]
        if len(rest) > 30:
            heights.append(float(np.quantile(rest[:, 2], 0.98)))
        for level in heights:
            for side in (1.0, -1.0):
                start = _start(normal, lid, rest, max(level, panels.THINNEST_M), side)
                if start is not None:
                    yield start


def _planes(points: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Normal and points (N,) bool of the largest planes, one after another."""
    left = np.ones(len(points), bool)
    for _ in range(PLANES):
        found = largest_plane(points[left])
        if found is None:
            return
        normal, offset = found
        mine = left & (np.abs(points @ normal - offset) < NEAR_M)
        if mine.sum() < LEAST_SHARE * len(points):
            return
        yield normal, mine
        left &= ~mine


def _start(normal: np.ndarray, lid: np.ndarray, rest: np.ndarray, level: float, side: float) -> np.ndarray | None:
    """Parameters with the lid in a plane, hinged at height `level`, and the base on one side of its hinge."""
    # y of the body points from the base across the crease.
    across = side * np.array([normal[0], normal[1]]) / np.linalg.norm(normal[:2])
    crease = np.array([across[1], -across[0]])
    rise = np.cross(np.array([crease[0], crease[1], 0.0]), normal)
    rise *= np.sign(rise[2]) / np.linalg.norm(rise)
    if rise[2] < LEAST_TILT:
        return None
    middle = lid.mean(axis=0)
    foot = middle + rise * (level - middle[2]) / rise[2]
    edge = float(foot[:2] @ across)
    length = float(np.quantile((lid - foot) @ rise, 0.99))
    left, right = np.quantile(lid[:, :2] @ crease, [0.005, 0.995])
    before = edge - rest[:, :2] @ across if len(rest) else np.zeros(0)
    seen = float(np.quantile(before, 0.99)) if len(before) > 30 else 0.0
    depth = seen if seen > 0.4 * length else length
    if length < LEAST_M or right - left < LEAST_M:
        return None
    centre = crease * (left + right) / 2 + across * (edge - depth / 2)
    yaw = float(np.arctan2(crease[1], crease[0]))
    angle = float(np.arctan2(rise[2], -rise[:2] @ across))
    return np.array([*centre, yaw, right - left, depth, level, length, panels.THIN_M, angle])
