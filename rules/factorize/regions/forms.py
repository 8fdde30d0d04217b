"""How well one simple form explains two groups together, beside one for each: terms of the description length of a scene.

Convex bodies, revolved ones and boxes need few numbers. If one form explains the points, the outline and the seen empty
space of two groups as well as two forms do, the groups are likely one object.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dextera_build.geometry import planes, regions

from .patches import Surfaces
from .relations import RELIEF_M, Group

RAYS = 300
"""Number of lines of sight that a convex body is compared with."""
SAMPLE = 120
"""Number of points of each group."""
EMPTY_M = 0.02
"""Depth of empty space within a convex body that is entirely wrong [m]."""
WALL = 0.9
"""Largest vertical part of the normal of a wall."""
PARALLEL = 0.96
"""Cosine of the angle between normals of one plane."""
FEWEST = 8
"""Least number of points of a wall."""
LARGEST_M = 0.15
"""Radii are at most this for the scale of a residual [m]."""


class Form(NamedTuple):
    """Samples of one group."""

    points: np.ndarray  # (n, 3) world [m]
    normals: np.ndarray  # (n, 3) world
    corners: np.ndarray  # (k, 3) of the convex hull
    outline: np.ndarray  # (k, 2) corners of the outline from above
    extent: np.ndarray  # (4,) first and last row and column
    hollow: float  # see `Sight.hollow`
    revolved: float  # see `revolved`


@dataclass(frozen=True)
class Sight:
    """The measured depth along the lines of sight of a crop."""

    eye: np.ndarray  # (3,)
    way: np.ndarray  # (3, 3): (row, column, 1) @ way is the direction of a line of sight, 1 long along the camera's axis
    depth: np.ndarray  # (h, w) [m], 0 if unknown
    tolerance: np.ndarray  # (h, w) [m]

    def hollow(self, corners: np.ndarray, extent: np.ndarray) -> float:
        """Fraction of a convex body's picture in which empty space is seen in it.

        Args:
            corners: (k, 3) corners of the body, perhaps with points inside [m].
            extent: First and last row and column of its picture.
        """
        faces = _faces(corners)
        if faces is None:
            return 0.0
        top, bottom, left, right = (int(v) for v in extent)
        step = max(1, round(np.sqrt((bottom - top + 1) * (right - left + 1) / RAYS)))
        rows, columns = (g.ravel() for g in np.mgrid[top : bottom + 1 : step, left : right + 1 : step])
        measured, tolerance = self.depth[rows, columns], self.tolerance[rows, columns]
        ways = np.column_stack([rows, columns, np.ones(len(rows))]) @ self.way
        along = ways @ faces[:, :3].T
        at = -(faces[:, :3] @ self.eye + faces[:, 3]) / np.where(np.abs(along) < 1e-12, 1e-12, along)
        enters = np.where(along < 0, at, -np.inf).max(axis=1)
        leaves = np.where(along > 0, at, np.inf).min(axis=1)
        hit = (enters < leaves) & (measured > 0) & (measured > enters - tolerance)
        if not hit.any():
            return 0.0
        empty = np.minimum(measured, leaves) - enters - tolerance
        return float(np.clip(empty[hit] / EMPTY_M, 0.0, 1.0).mean())


def sight(s: Surfaces) -> Sight:
    """The lines of sight of a crop; over the support they end on it."""
    rows, columns = np.nonzero(s.inverse > 0)
    some = slice(None, None, max(1, len(rows) // 500))
    rows, columns = rows[some], columns[some]
    ways = (s.points[rows, columns] - s.eye) * s.inverse[rows, columns][:, None]
    way = np.linalg.lstsq(np.column_stack([rows, columns, np.ones(len(rows))]), ways, rcond=None)[0]
    grid = np.moveaxis(np.indices(s.inverse.shape, dtype=np.float64), 0, -1)
    down = grid @ way[:2, 2] + way[2, 2]
    floor = np.where(s.floor & (down < -1e-6), -s.eye[2] / np.where(down < -1e-6, down, -1.0), 0.0)
    own = np.where(s.inverse > 0, 1.0 / np.where(s.inverse > 0, s.inverse, 1.0), 0.0)
    depth = np.where(own > 0, own, np.where(s.floor, floor, s.beyond))
    return Sight(s.eye, way, depth, RELIEF_M + 2.0 * planes.depth_sigma(np.maximum(depth, 0.1)))


def form(s: Surfaces, lines: Sight, group: Group) -> Form:
    """The form of one group."""
    some = group.pixels[:: max(1, len(group.pixels) // SAMPLE)]
    points, normals = s.points.reshape(-1, 3)[some], s.normal.reshape(-1, 3)[some]
    rows, columns = np.divmod(group.pixels, s.inverse.shape[1])
    extent = np.array([rows.min(), rows.max(), columns.min(), columns.max()])
    corners = _corners(points)
    return Form(
        points,
        normals,
        corners,
        regions.convex_hull(points[:, :2]),
        extent,
        lines.hollow(corners, extent),
        revolved(points, normals),
    )


def together(lines: Sight, a: Form, b: Form) -> tuple[float, ...]:
    """Terms of two groups: of one form for both, of the smaller's own, of the larger's own."""
    corners = np.concatenate([a.corners, b.corners])
    low, high = np.minimum(a.extent, b.extent), np.maximum(a.extent, b.extent)
    extent = np.array([low[0], high[1], low[2], high[3]])
    outline = regions.convex_hull(np.concatenate([a.outline, b.outline]))
    points, normals = np.concatenate([a.points, b.points]), np.concatenate([a.normals, b.normals])
    outlines = (outline, a.outline, b.outline)
    return (
        *(3.0 * value for value in (lines.hollow(corners, extent), a.hollow, b.hollow)),
        *(3.0 * value for value in (revolved(points, normals), a.revolved, b.revolved)),
        *(rectangular(own) for own in outlines),
        *(circular(own) for own in outlines),
        coplanar(a, b),
        aligned(a, b),
    )


def revolved(points: np.ndarray, normals: np.ndarray) -> float:
    """Distance of the lines along the walls' normals from a common upright axis, over the radius, 0 to 1.

    It is small for one wall that is flat: its axis is undetermined.
    """
    flat = normals[:, :2]
    length = np.linalg.norm(flat, axis=1)
    wall = (np.abs(normals[:, 2]) < WALL) & (length > 0)
    if wall.sum() < FEWEST:
        return 0.0
    at = points[wall, :2]
    across = np.column_stack([-flat[wall, 1], flat[wall, 0]]) / length[wall, None]
    middle = at.mean(axis=0)
    target = (across * (at - middle)).sum(axis=1)
    matrix = across.T @ across + 0.02 * len(at) * np.eye(2)
    centre = middle + np.linalg.solve(matrix, across.T @ target)
    off = np.abs((across * (at - centre)).sum(axis=1))
    radius = min(float(np.median(np.linalg.norm(at - centre, axis=1))), LARGEST_M)
    return float(min(np.mean(off) / max(radius, 0.005), 1.0))


def rectangular(outline: np.ndarray) -> float:
    """Area of a convex outline over that of the least rectangle around it, 0.5 to 1; 1 for a line."""
    if len(outline) < 3:
        return 1.0
    sides = np.roll(outline, -1, axis=0) - outline
    angle = np.arctan2(sides[:, 1], sides[:, 0])
    along = np.ptp(outline @ np.stack([np.cos(angle), np.sin(angle)]), axis=0)
    aside = np.ptp(outline @ np.stack([-np.sin(angle), np.cos(angle)]), axis=0)
    return float(abs(regions.area(outline)) / max(float((along * aside).min()), 1e-9))


def circular(outline: np.ndarray) -> float:
    """Area of a convex outline over that of the circle of the same length, 0 to 1."""
    if len(outline) < 3:
        return 0.0
    length = float(np.linalg.norm(np.roll(outline, -1, axis=0) - outline, axis=1).sum())
    return float(4.0 * np.pi * abs(regions.area(outline)) / max(length**2, 1e-12))


def coplanar(small: Form, large: Form) -> float:
    """Fraction of the smaller group's points whose plane has points of the larger one."""
    p, n = small.points[::3], small.normals[::3]
    q, m = large.points[::3], large.normals[::3]
    off = np.abs((p * n).sum(axis=1)[:, None] - n @ q.T)
    return float(((off < RELIEF_M) & (n @ m.T > PARALLEL)).any(axis=1).mean())


def aligned(a: Form, b: Form) -> float:
    """How far the walls of two groups are parallel or at right angles, -1 to 1; 0 for round ones."""
    ends = [_fourfold(one.normals) for one in (a, b)]
    return float((ends[0] * np.conj(ends[1])).real)


def _fourfold(normals: np.ndarray) -> complex:
    wall = (np.abs(normals[:, 2]) < WALL) & (np.linalg.norm(normals, axis=1) > 0)
    if wall.sum() < FEWEST:
        return 0j
    return complex(np.exp(4j * np.arctan2(normals[wall, 1], normals[wall, 0])).mean())


def _corners(points: np.ndarray) -> np.ndarray:
    from scipy.spatial import ConvexHull, QhullError

    if len(points) < 6:
        return points
    try:
        return np.asarray(points[ConvexHull(points, qhull_options="QJ").vertices])
    except QhullError:
        return points


def _faces(corners: np.ndarray) -> np.ndarray | None:
    """Outward planes (f, 4) of a convex hull; None without one."""
    from scipy.spatial import ConvexHull, QhullError

    if len(corners) < 4:
        return None
    try:
        return np.asarray(ConvexHull(corners, qhull_options="QJ").equations)
    except QhullError:
        return None
