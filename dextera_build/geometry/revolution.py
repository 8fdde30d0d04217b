"""The vertical axis of a surface of revolution from its seen points and normals."""

from __future__ import annotations

import numpy as np

NEAR_M = 0.004
"""Distance of a normal's line from the axis at which its weight is halved [m]."""
PULL = 1e-3
"""Weight of the points' mean, relative to that of the normals."""


def vertical_axis(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Position (2,) of the vertical axis nearest to the lines of the normals, robust to outliers [m].

    A surface of revolution, convex or the inside of a cup, has all its normals in planes through the axis.

    Args:
        points: (N, 2) seen from above [m].
        normals: (N, 2) unit, the level part of the normals there.
    """
    rows = np.stack([normals[:, 1], -normals[:, 0]], axis=-1)
    right = (rows * points).sum(axis=1)
    weight = np.ones(len(points))
    centre = points.mean(axis=0)
    for _ in range(15):
        # A weak pull towards the points keeps flat fronts, whose normals are parallel, from diverging.
        normal = (rows * weight[:, None]).T @ rows + PULL * len(points) * np.eye(2)
        pulled = (rows * weight[:, None]).T @ right + PULL * len(points) * points.mean(axis=0)
        centre = np.linalg.solve(normal, pulled)
        weight = 1.0 / (1.0 + (off_axis(points, normals, centre) / NEAR_M) ** 2)
    return np.asarray(centre)


def off_axis(points: np.ndarray, normals: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Signed distance (N,) of the normals' lines from the axis at `centre` (2,) [m]; see `vertical_axis`."""
    rows = np.stack([normals[:, 1], -normals[:, 0]], axis=-1)
    return np.asarray(rows @ centre - (rows * points).sum(axis=1))
