"""A body for a view that shows too little to fit one: the convex hull of the seen points, down to what it stands on."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import convex, transforms
from dextera_build.geometry.solids import Solid

from .evidence import Evidence
from .hypotheses import Finished

FEWEST = 12
"""Fewer points tell no shape."""
THIN_M = 0.004
"""Smallest extent that is left as it is [m]."""


def standing_hull(evidence: Evidence) -> Finished | None:
    """The hull of the points and of their feet on the surface below; None if there are fewer than 12.

    It is closed, has a volume and rests where it is, whatever the points are. The outermost 2 % are pulled in.
    """
    points = evidence.points if len(evidence.points) >= FEWEST else _measured(evidence)
    if len(points) < FEWEST:
        return None
    low, high = np.quantile(points, [0.02, 0.98], axis=0)
    kept = np.clip(points, low, high)
    kept[:, 2] = np.maximum(kept[:, 2], THIN_M)
    foot = np.array([*(low + high)[:2] / 2, 0.0])
    cloud = np.concatenate([kept, kept * [1.0, 1.0, 0.0]]) - foot
    vertices, faces = convex.surface(cloud, THIN_M)
    lifted = vertices.astype(np.float64) - [0.0, 0.0, float(vertices[:, 2].min())]
    body = Solid(lifted, faces.astype(np.int64))
    return Finished(body, transforms.rigid(np.eye(3), foot), (body.vertices,))


def _measured(evidence: Evidence) -> np.ndarray:
    """Points (N, 3) of all pixels of the mask with a depth, in the frame of `Evidence.points`."""
    rows, columns = np.nonzero(evidence.mask & evidence.known & (evidence.depth > 0))
    k = evidence.k
    rays = np.stack([(columns - k[0, 2]) / k[0, 0], (rows - k[1, 2]) / k[1, 1], np.ones(len(rows))], axis=1)
    return transforms.apply(evidence.world_from_camera, rays * evidence.depth[rows, columns][:, None])
