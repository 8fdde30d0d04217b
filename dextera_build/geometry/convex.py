"""Convex pieces defined by their corner points: surfaces, overlaps and cuts."""

from __future__ import annotations

from functools import cached_property

import numpy as np

THINNEST_M = 2e-4
"""Minimum thickness, because physics engines reject flat pieces; 0.2 mm is below any measurement error here."""
SLIVER = 1e-9
"""Volume of a cut piece below which it is dropped [m^3]."""


def surface(points: np.ndarray, thinnest: float = THINNEST_M) -> tuple[np.ndarray, np.ndarray]:
    """Convex hull of `points` as triangles; flat, straight and single-point sets are thickened first.

    Args:
        points: (N, 3) corner points [m], N >= 1.
        thinnest: Directions with a smaller extent are thickened [m].

    Returns:
        (V, 3) float32 hull corners and (F, 3) int32 faces, counter-clockwise seen from outside; the same points give
        the same bytes.
    """
    from scipy.spatial import ConvexHull

    solid = thicken(np.unique(points.astype(np.float64), axis=0), thinnest)
    hull = ConvexHull(solid, qhull_options="Qt")
    faces = hull.simplices.astype(np.int64)
    corners = solid[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # Qhull does not define the order of a facet's corners, but its plane equations point outwards.
    inward = (normals * hull.equations[:, :3]).sum(axis=1) < 0
    faces[inward] = faces[inward][:, ::-1]
    used, compact = np.unique(faces, return_inverse=True)
    return solid[used].astype(np.float32), compact.reshape(-1, 3).astype(np.int32)


def thicken(points: np.ndarray, thinnest: float = THINNEST_M) -> np.ndarray:
    """`points` (N, 3) [m], duplicated to both sides along every direction with an extent below `thinnest`."""
    # Rows of zeros give three axes even for one or two points; the full left matrix would take (N, N) numbers.
    _, _, axes = np.linalg.svd(np.concatenate([points - points.mean(axis=0), np.zeros((3, 3))]), full_matrices=False)
    for axis in axes:
        along = points @ axis
        if along.max() - along.min() < thinnest:
            points = np.concatenate([points - axis * thinnest / 2, points + axis * thinnest / 2])
    return points


class Convex:
    """A convex piece by its corners (V, 3) in the world [m]."""

    def __init__(self, corners: np.ndarray) -> None:
        self.corners = corners.astype(np.float64)
        self.low, self.high = self.corners.min(axis=0), self.corners.max(axis=0)

    @cached_property
    def _hull(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Unit normals (F, 3) outwards, edges (E, 2, 3), and the volume."""
        from scipy.spatial import ConvexHull

        hull = ConvexHull(thicken(self.corners), qhull_options="Qt")
        sides = hull.simplices[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        edges = hull.points[np.unique(np.sort(sides, axis=1), axis=0)]
        return np.unique(hull.equations[:, :3].round(9), axis=0), edges, float(hull.volume)

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        return self._hull[2]

    def overlap(self, other: Convex) -> tuple[float, np.ndarray, float]:
        """Least overlap [m], at most 0 if disjoint, and the plane n x = d beyond which `other` does not extend."""
        if (self.low >= other.high).any() or (other.low >= self.high).any():
            return 0.0, np.zeros(3), 0.0
        normals = np.concatenate([other._hull[0], -self._hull[0]])
        ends = (normals @ other.corners.T).max(axis=1)
        deep = ends - (normals @ self.corners.T).min(axis=1)
        least = int(deep.argmin())
        return float(deep[least]), normals[least], float(ends[least])

    def beyond(self, normal: np.ndarray, end: float) -> Convex | None:
        """The part with `normal` x >= `end`; None if it is a sliver."""
        edges = self._hull[1]
        starts, stops = edges[:, 0] @ normal - end, edges[:, 1] @ normal - end
        crossing = starts * stops < 0.0
        share = (starts / np.where(crossing, starts - stops, 1.0))[crossing, None]
        met = edges[crossing, 0] + share * (edges[crossing, 1] - edges[crossing, 0])
        kept = np.concatenate([edges[:, 0][starts >= 0.0], edges[:, 1][stops >= 0.0], met])
        kept = np.unique(kept, axis=0)
        if len(kept) < 4:
            return None
        part = Convex(kept)
        return part if part.volume > SLIVER else None
