"""Rotational symmetries of a mesh about its vertical axis, for trackers that require them."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import lie, metrics, transforms

SAMPLES = 1500
ROUND = 36
"""Number of rotations that represent continuous symmetry."""
_UP = np.array([0.0, 0.0, 1.0])
_SAME = 0.015
"""Maximum distance between a rotated surface and itself, relative to its size, for a symmetry."""


def turns(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Rotations (S, 4, 4), identity first, that map the surface to itself: continuous, half or quarter turns.

    Args:
        vertices: (V, 3) [m].
        faces: (F, 3).
    """
    points = metrics.sample_surface(vertices.astype(np.float64), faces, SAMPLES, seed=0)
    dense = metrics.sample_surface(vertices.astype(np.float64), faces, 20 * SAMPLES, seed=1)
    middle = (vertices.min(axis=0) + vertices.max(axis=0)).astype(np.float64) / 2
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))

    def stays(angle: float) -> bool:
        off = metrics.nearest(transforms.apply(lie.turned(_UP, middle, angle), points), dense)
        return float(np.quantile(off, 0.99)) < _SAME * size

    if all(stays(angle) for angle in (0.37, 0.9, 1.7)):
        count = ROUND
    else:
        count = 4 if stays(np.pi / 2) else 2 if stays(np.pi) else 1
    return np.stack([lie.turned(_UP, middle, 2 * np.pi * number / count) for number in range(count)])
