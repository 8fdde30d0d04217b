"""Which plane of the room removed pixels show: at the inner edge of a wall and the floor, the nearer one is seen."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import cv2
import numpy as np

from dextera_build.geometry import planes

from .layers import grown
from .patch import SUPPORT, Patch

SAME_M = 0.04
"""Median distance of the points of a curved surface from a plane that it is a part of [m]."""
NOISE_M = 0.02
"""Depth by which a plane may be behind another one where it is seen [m]."""
MOST = 0.95
"""Fraction of the pixels of each of two planes that must be in front of the other one."""
BESIDE = 0.02
"""Planes this near to removed pixels may go on there, as a fraction of the width."""


def met(
    labels: np.ndarray,
    taken: np.ndarray,
    measured: np.ndarray,
    points: np.ndarray,
    found: Mapping[int, planes.Plane | None],
    k: np.ndarray,
) -> np.ndarray:
    """Labels (H, W) int32 with the edges between planes of the room continued through removed pixels.

    Two planes meet at an inner edge if each is seen where it is the nearer one. Other labels are kept.

    Args:
        labels: (H, W) surface of each pixel.
        taken: (H, W) removed pixels.
        measured: (H, W) surface of each pixel whose depth was measured; 0 elsewhere.
        points: (H, W, 3) in the camera frame [m].
        found: Plane of each surface in the camera frame; None for a curved one.
        k: (3, 3) intrinsics [px].
    """
    flat = {n: plane for n, plane in found.items() if plane is not None and n != SUPPORT and (measured == n).any()}
    if not flat or not (taken & (labels != SUPPORT)).any():
        return labels
    columns, rows = np.meshgrid(np.arange(labels.shape[1], dtype=np.float64), np.arange(labels.shape[0]))
    pixel = np.stack([columns, rows], axis=-1)
    depth = {n: Patch(n, plane).depth(pixel, k) for n, plane in flat.items()}
    pairs = [pair for pair in combinations(flat, 2) if _inner(*pair, measured, depth)]
    result = labels.copy()
    _, holes = cv2.connectedComponents(taken.astype(np.uint8), connectivity=4)
    reach = max(2, round(BESIDE * labels.shape[1]))
    near = {n: set(np.unique(holes[grown(measured == n, reach) & taken])) for n in flat}
    for number in (n for n, plane in found.items() if plane is None):
        for plane in _planes_of(points[measured == number], flat):
            result[taken & (result == number) & np.isin(holes, list(near[plane]))] = plane
    for one, other in pairs:
        both = taken & np.isin(result, (one, other)) & np.isin(holes, list(near[one] & near[other]))
        result[both] = np.where(depth[one] <= depth[other], one, other)[both]
    return result


def _inner(one: int, other: int, measured: np.ndarray, depth: Mapping[int, np.ndarray]) -> bool:
    """Whether two planes meet at an inner edge."""
    for own, rest in ((one, other), (other, one)):
        where = measured == own
        if (depth[own][where] <= depth[rest][where] + NOISE_M).mean() < MOST:
            return False
    # Parts of the same plane do not meet.
    where = (measured == one) | (measured == other)
    return float((np.abs(depth[one][where] - depth[other][where]) < SAME_M).mean()) < 1.0 - MOST / 2


def _planes_of(points: np.ndarray, flat: Mapping[int, planes.Plane]) -> list[int]:
    """The planes near which most of the points (N, 3) are, the nearest first."""
    if not len(points):
        return []
    away = {n: float(np.median(np.abs(points @ normal + offset))) for n, (normal, offset) in flat.items()}
    return sorted((n for n in away if away[n] < SAME_M), key=lambda n: away[n])
