"""Rectangular vessels: boxes open at the top with rounded corners and slanted walls: baskets, trays, bins, cartons."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dextera_build.geometry import solids
from dextera_build.geometry.solids import Solid

from ..evidence import Evidence
from ..refine import Model
from .box import LARGEST_M, SMALLEST_M, spans, upright
from .profile import FLOOR_M, THINNEST_M

ARC = 4
"""Corners of the outline at each rounded corner."""
RIM_M = 0.012
"""Points within this depth below the highest points are on the rim [m]."""
INWARDS_M = 0.012
"""Minimum depth below the rim, and distance from its outline, of points on the inside [m]."""
FACING = 0.4
"""Minimum inward component of the normal of a point on the inside, which may be near the outline."""
LEAST_PART = 0.04
"""Smallest fraction of the points on the inside."""
SLOPES = (0.0, 0.2)
"""Slopes of the walls that are tried: horizontal over vertical."""


def open_box(evidence: Evidence, wall_m: float) -> Model | None:
    """x, y, yaw, width, depth, height, slope, corner radius, wall, floor; None unless the inside is visible.

    Width and depth [m] are those of the rim, the slope is the outward lean of the walls per height, the wall's
    thickness is measured horizontally, the floor is the height of the cavity's floor.
    """
    seen = inside(evidence)
    if seen.mean() < LEAST_PART:
        return None
    height = evidence.height
    floor = float(np.clip(np.quantile(evidence.points[seen, 2], 0.1), wall_m, 0.9 * height))
    rim = evidence.points[evidence.points[:, 2] > height - RIM_M, :2]
    starts = []
    for angle in np.deg2rad(np.arange(0.0, 90.0, 7.5)):
        low, high = spans(rim, angle)
        size = np.maximum(high - low, 4 * SMALLEST_M)
        middle = upright(0.0, 0.0, angle)[:2, :2] @ ((low + high) / 2)
        starts.append([*middle, angle, *size, height])
    starts.sort(key=lambda start: float(start[3] * start[4]))
    inf = np.inf
    first = starts[0]
    widest = 0.25 * min(first[3:5])
    return Model(
        name="open_box",
        build=lambda p: open_box_body(p).moved(upright(p[0], p[1], p[2])),
        starts=[np.array([*s, slope, min(0.01, widest), wall_m, floor]) for s in starts[:2] for slope in SLOPES],
        steps=np.array([0.003, 0.003, 0.02, 0.003, 0.003, 0.003, 0.02, 0.004, 0.0015, 0.003]),
        lower=np.array([-inf] * 3 + [4 * SMALLEST_M] * 2 + [SMALLEST_M, -0.15, 0.001, THINNEST_M, THINNEST_M]),
        upper=np.array([inf] * 3 + [LARGEST_M] * 3 + [0.8, 2 * widest, widest, 0.9 * height]),
        expected=np.array([0.0] * 3 + [*first[3:6], 0.0, 0.01, wall_m, wall_m]),
        # For a hidden floor, the wall's thickness is the best guess; visible points outweigh it.
        spread=np.array([inf] * 3 + [0.1] * 3 + [0.4, 0.02, 0.004, 4 * FLOOR_M]),
        cost=0.01,
    )


def inside(evidence: Evidence) -> np.ndarray:
    """Points (N,) bool of a cavity: below the rim, and well inside its outline in plan or facing inwards."""
    import cv2

    height = evidence.height
    rim = evidence.points[evidence.points[:, 2] > height - RIM_M, :2]
    if len(rim) < 20 or height < 1.5 * INWARDS_M:
        return np.zeros(len(evidence.points), bool)
    outline = cv2.convexHull(rim.astype(np.float32))[:, 0].astype(np.float64)
    edges = np.roll(outline, -1, axis=0) - outline
    lengths = np.maximum(np.linalg.norm(edges, axis=1), 1e-9)
    normals = np.stack([-edges[:, 1], edges[:, 0]], axis=-1) / lengths[:, None]
    offsets = (normals * outline).sum(axis=1)
    # OpenCV's orientation follows its own axes: the centre of the outline is inside.
    sign = np.sign((normals @ outline.mean(axis=0) - offsets).mean())
    clear = sign * (evidence.points[:, :2] @ normals.T - offsets)
    below = evidence.points[:, 2] < height - INWARDS_M
    inwards = outline.mean(axis=0) - evidence.points[:, :2]
    inwards /= np.maximum(np.linalg.norm(inwards, axis=1, keepdims=True), 1e-9)
    facing = (evidence.normals[:, :2] * inwards).sum(axis=1) > FACING
    depth = clear.min(axis=1)
    return np.asarray(below & ((depth > INWARDS_M) | (facing & (depth > 0.0))))


def open_box_body(p: np.ndarray) -> Solid:
    """The vessel in its own frame, base on z = 0."""
    outer, inner = rings(p)
    return solids.loft(np.concatenate([outer, inner]))


def rings(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rings of the outside, base and rim, and of the cavity, rim and floor: each (2, 4 ARC, 3).

    The edges of all rings are parallel, so that the walls between them are planar.
    """
    half, height, slope, radius = p[3:5] / 2, p[5], p[6], p[7]

    def ring(z: float, inset: float) -> np.ndarray:
        size = np.maximum(half - slope * (height - z) - inset, SMALLEST_M / 3)
        return _rounded(size, float(np.clip(radius - inset, 2e-4, 0.98 * size.min())), z)

    return nested(ring, height, p[8], p[9])


def nested(
    ring: Callable[[float, float], np.ndarray], height: float, wall: float, floor: float
) -> tuple[np.ndarray, np.ndarray]:
    """Rings of the outside, base and rim, and of the cavity, rim and floor: each (2, N, 3).

    Args:
        ring: Function that returns the outline (N, 3) at a height and an inset from the outside [m].
        height: Height of the rim [m].
        wall: Thickness of the walls [m].
        floor: Height of the cavity's floor [m], at most nine tenths of the rim's.
    """
    floor = min(floor, 0.9 * height)
    return np.stack([ring(0.0, 0.0), ring(height, 0.0)]), np.stack([ring(height, wall), ring(floor, wall)])


def _rounded(half: np.ndarray, radius: float, z: float) -> np.ndarray:
    """(4 ARC, 3) outline of a rectangle with half sizes (2,) and rounded corners, counter-clockwise."""
    turn = np.linspace(0.0, np.pi / 2, ARC)
    points = []
    for quarter, (sx, sy) in enumerate([(1, 1), (-1, 1), (-1, -1), (1, -1)]):
        centre = (half - radius) * [sx, sy]
        angle = turn + quarter * np.pi / 2
        points.append(centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1))
    flat = np.concatenate(points)
    return np.column_stack([flat, np.full(len(flat), z)])


def walls(p: np.ndarray) -> tuple[np.ndarray, ...]:
    """Corner points (V, 3) of exact convex pieces; see `between`."""
    return between(*rings(p))


def between(outer: np.ndarray, inner: np.ndarray) -> tuple[np.ndarray, ...]:
    """Corner points (V, 3) of convex pieces: the floor, and a slab between two corners of the outline each.

    Args:
        outer: (2, N, 3) rings of the outside, base and rim.
        inner: (2, N, 3) rings of the cavity, rim and floor, whose edges are parallel to those of `outer`.
    """
    part = inner[1, 0, 2] / outer[1, 0, 2]
    level = outer[0] * (1.0 - part) + outer[1] * part
    skin, lining = np.stack([level, outer[1]]), inner
    count = outer.shape[1]
    pieces = [np.concatenate([outer[0], level])]
    for column in range(count):
        pair = [column, (column + 1) % count]
        pieces.append(np.concatenate([skin[:, pair], lining[:, pair]]).reshape(-1, 3))
    return tuple(pieces)
