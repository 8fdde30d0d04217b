"""Fit the plane with the most inliers."""

from __future__ import annotations

import numpy as np

TRIES = 300
"""Number of random triples."""
NEAR_M = 0.004
"""Maximum distance of an inlier [m]."""
LEAST = 50
"""Minimum number of inliers."""


def largest_plane(points: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Unit normal (3,) and offset [m] of the plane with the most inliers of (N, 3), refined on them; seeded."""
    random = np.random.default_rng(0)
    best, most = None, 0
    for _ in range(TRIES if len(points) >= LEAST else 0):
        a, b, c = points[random.choice(len(points), 3, replace=False)]
        normal = np.cross(b - a, c - a)
        size = float(np.linalg.norm(normal))
        if size < 1e-8:
            continue
        near = np.abs((points - a) @ (normal / size)) < NEAR_M
        if near.sum() > most:
            best, most = near, int(near.sum())
    if best is None or most < LEAST:
        return None
    middle = points[best].mean(axis=0)
    normal = np.linalg.eigh(np.cov((points[best] - middle).T))[1][:, 0]
    return normal, float(normal @ middle)
