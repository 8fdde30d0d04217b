"""Turns of a mesh about its vertical axis that change nothing, for trackers that must be told."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import metrics, registration, transforms

SAMPLES = 1500
ROUND = 36
"""Turns that stand for any turn."""
_SAME = 0.015
"""Distance of a turned surface from itself up to which it is the same, in parts of its size."""


def turns(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Motions (S, 4, 4), the identity first, by which the surface stays the same: any turn, half turns or quarters.

    Args:
        vertices: (V, 3) [m].
        faces: (F, 3).
    """
    points = metrics.sample_surface(vertices.astype(np.float64), faces, SAMPLES, seed=0)
    dense = metrics.sample_surface(vertices.astype(np.float64), faces, 20 * SAMPLES, seed=1)
    middle = (vertices.min(axis=0) + vertices.max(axis=0)).astype(np.float64) / 2
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))

    def stays(angle: float) -> bool:
        off = metrics.nearest(transforms.apply(_turn(angle, middle), points), dense)
        return float(np.quantile(off, 0.99)) < _SAME * size

    if all(stays(angle) for angle in (0.37, 0.9, 1.7)):
        count = ROUND
    else:
        count = 4 if stays(np.pi / 2) else 2 if stays(np.pi) else 1
    return np.stack([_turn(2 * np.pi * number / count, middle) for number in range(count)])


def _turn(angle: float, middle: np.ndarray) -> np.ndarray:
    turn = registration.rotation(np.array([0.0, 0.0, angle]))
    return transforms.rigid(turn, middle - turn @ middle)
