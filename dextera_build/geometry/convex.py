"""Triangle surfaces of convex pieces that are given by their corner points."""

from __future__ import annotations

import numpy as np

THINNEST_M = 2e-4
"""Physics engines refuse flat pieces; a fifth of a millimetre is below any measurement here."""


def surface(points: np.ndarray, thinnest: float = THINNEST_M) -> tuple[np.ndarray, np.ndarray]:
    """Convex hull of `points` as triangles; flat, straight and single-point sets are thickened first.

    Args:
        points: (N, 3) corner points [m], N >= 1.
        thinnest: Smallest extent along any direction that is left as it is [m].

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
    """`points` (N, 3) [m], doubled to both sides along every direction in which they extend less than `thinnest`."""
    # Rows of zeros give three axes also for one or two points; the full left matrix would take (N, N) numbers.
    _, _, axes = np.linalg.svd(np.concatenate([points - points.mean(axis=0), np.zeros((3, 3))]), full_matrices=False)
    for axis in axes:
        along = points @ axis
        if along.max() - along.min() < thinnest:
            points = np.concatenate([points - axis * thinnest / 2, points + axis * thinnest / 2])
    return points
