"""Starting parameters for fitting two hinged slabs: each large plane may be the lid."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dextera_build.geometry import planes

from ..shapes.evidence import Evidence
from ..shapes.families import panels

MOST = 4000
"""Maximum number of points used."""
PLANES = 3
"""Number of planes that are tried as the lid."""
LEAST_SHARE = 0.06
"""Smallest fraction of the seen points on a plane that may be the lid."""
LEAST_TILT = 0.05
"""Smallest horizontal component of the lid's normal: a more level lid does not determine a hinge (3 deg)."""
BIN_M = 0.003
"""Thickness of the layers in which the distance from the lid's plane is averaged [m]."""
STEP_M = 0.001
"""Distance of two layers [m]."""
LEAST_BIN = 30
"""Minimum number of points of a layer."""
AWAY = 1.0
"""Median distance of a layer from the lid's plane above which it is not part of the lid, in standard deviations."""
APART_M = 0.003
"""Minimum difference between two starting heights [m]; a fit closes smaller ones."""
LEAST_M = 0.03
"""Minimum length and width of a lid [m]."""


def starts(evidence: Evidence) -> Iterator[np.ndarray]:
    """Starting parameters of `panels`: each large plane as the lid, on either side of the base, at several heights."""
    step = max(1, len(evidence.points) // MOST)
    points, sigma = evidence.points[::step], evidence.point_sigma[::step]
    for plane, mine in _planes(points, sigma):
        if float(np.linalg.norm(plane[0][:2])) < LEAST_TILT:
            continue
        lid, rest = points[mine], points[~mine]
        off = planes.distance(plane, evidence.points) / evidence.point_sigma
        for level in _levels(evidence.points[:, 2], off, lid[:, 2], rest[:, 2]):
            for side in (1.0, -1.0):
                start = _start(plane[0], lid, rest, max(level, panels.THINNEST_M), side, evidence.eye)
                if start is not None:
                    yield start


def _levels(heights: np.ndarray, off: np.ndarray, lid: np.ndarray, rest: np.ndarray) -> list[float]:
    """Heights at which the base may end [m], at least `APART_M` apart.

    A single one is not reliable: points of the base's back are within the noise of an overhanging lid's plane, and the
    remaining points may be those of the lid's edge.

    Args:
        heights: (N,) of all points [m].
        off: (N,) their distances from the lid's plane, in standard deviations.
        lid: Heights of the points on that plane [m].
        rest: Heights of the others [m].
    """
    foot = _foot(heights, off, float(np.median(lid)))
    # Seen from behind and above, an overhanging lid hides the end of the base by about its thickness.
    found = [foot, foot + panels.THIN_M]
    if len(rest) > LEAST_BIN:
        found.append(_top(rest))
    found += [float(np.quantile(lid, 0.01)), panels.BASE_M]
    return [each for k, each in enumerate(found) if all(abs(each - other) > APART_M for other in found[:k])]


def _foot(heights: np.ndarray, off: np.ndarray, middle: float) -> float:
    """The height, below `middle`, at which the surface leaves the lid's plane [m]; the lowest one if it does not.

    The median of a layer averages the noise, so that it shows a step of less than one standard deviation.
    """
    order = np.argsort(heights)
    heights, off = heights[order], off[order]
    tops = np.arange(middle, heights[0], -STEP_M)
    first, last = np.searchsorted(heights, tops - BIN_M), np.searchsorted(heights, tops)
    for top, start, end in zip(tops, first, last, strict=True):
        if end - start > LEAST_BIN and abs(float(np.median(off[start:end]))) > AWAY:
            return float(top)
    return float(heights[0])


def _top(rest: np.ndarray) -> float:
    """The height at which the number of points per layer falls most [m]: the base's top."""
    heights = np.sort(rest)
    tops = np.arange(heights[0], heights[-1] + STEP_M, STEP_M)
    below, here, above = (np.searchsorted(heights, tops + by) for by in (-BIN_M, 0.0, BIN_M))
    return float(tops[np.argmax((here - below + LEAST_BIN) / (above - here + LEAST_BIN))])


def _planes(points: np.ndarray, sigma: np.ndarray) -> Iterator[tuple[planes.Plane, np.ndarray]]:
    """The largest planes and their points (N,) bool, one after another."""
    left = np.ones(len(points), bool)
    least = max(3, int(LEAST_SHARE * len(points)))
    for _ in range(PLANES):
        found = planes.largest(points[left], sigma[left], np.random.default_rng(0), least=least)
        if found is None:
            return
        mine = left.copy()
        mine[left] = found[1]
        yield found[0], mine
        left &= ~mine


def _start(
    normal: np.ndarray, lid: np.ndarray, rest: np.ndarray, level: float, side: float, eye: np.ndarray
) -> np.ndarray | None:
    """Parameters with a lid whose face towards `eye` (3,) is seen, hinged at height `level`, and the base beside it."""
    # y of the body points from the base across the crease.
    across = side * np.array([normal[0], normal[1]]) / np.linalg.norm(normal[:2])
    crease = np.array([across[1], -across[0]])
    rise = np.cross(np.array([crease[0], crease[1], 0.0]), normal)
    rise *= np.sign(rise[2]) / np.linalg.norm(rise)
    if rise[2] < LEAST_TILT:
        return None
    angle = float(np.arctan2(rise[2], -rise[:2] @ across))
    outward = np.array([*(across * np.sin(angle)), np.cos(angle)])
    middle = lid.mean(axis=0)
    if outward @ (eye - middle) > 0.0:
        middle = middle - panels.THIN_M * outward  # the inner face runs through the hinge
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
    return np.array([*centre, yaw, right - left, depth, level, length, panels.THIN_M, angle])
