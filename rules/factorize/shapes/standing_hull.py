"""A body for a view with too little information for a fit: the convex hull of the seen points down to the ground."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import convex, transforms
from dextera_build.geometry.solids import Solid

from .evidence import Evidence
from .hypotheses import Finished

FEWEST = 12
"""Minimum number of points."""
THIN_M = 0.004
"""Smaller extents are enlarged to this [m]."""


def standing_hull(evidence: Evidence) -> Finished | None:
    """The hull of the points and of their projections onto the surface below; None if there are fewer than 12.

    It is closed, has a volume and rests in place for any points. The outermost 2 % are clamped.
    """
    points = evidence.points if len(evidence.points) >= FEWEST else _measured(evidence)
    if len(points) < FEWEST:
        return None
    low, high = np.quantile(points, [0.02, 0.98], axis=0)
    kept = np.clip(points, low, high)
    kept[:, 2] = np.maximum(kept[:, 2], THIN_M)
    foot = np.array([*(low + high)[:2] / 2, 0.0])
    cloud = with_feet(kept) - foot
    vertices, faces = convex.surface(cloud, THIN_M)
    lifted = vertices.astype(np.float64) - [0.0, 0.0, float(vertices[:, 2].min())]
    body = Solid(lifted, faces.astype(np.int64))
    return Finished(body, transforms.rigid(np.eye(3), foot), (body.vertices,))


def with_feet(points: np.ndarray) -> np.ndarray:
    """Points (N, 3) and their projections onto the surface below, z = 0 [m]."""
    return np.concatenate([points, points * [1.0, 1.0, 0.0]])


def _measured(evidence: Evidence) -> np.ndarray:
    """Points (N, 3) of all pixels of the mask with a depth, in the frame of `Evidence.points`."""
    return evidence.world_points(evidence.mask & evidence.known & (evidence.depth > 0))
