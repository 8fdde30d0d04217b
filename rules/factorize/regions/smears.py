"""Detection of depth smeared between an object and the support behind it, before grouping.

Stereo cameras fill the half-occluded band next to an object with depths between both surfaces. Such a surface is
parallel to the lines of sight, and the picture shows the support there.
"""

from __future__ import annotations

import numpy as np

from .patches import Surfaces

GRAZING = 0.35
"""Cosine between a smear's normal and the line of sight; sides of round bodies share it, but not the colours."""
NEAR_LAB = 0.25
"""Weight of a distance of one pixel in the comparison of colours [CIE Lab per px]."""
ALIKE = 0.6
"""Maximum distance of a smear's colour from the support's, as a fraction of its distance from the objects'."""
MOST = 4000
"""Samples of the support and of the objects with which colours are compared."""


def smeared(s: Surfaces, support: np.ndarray) -> np.ndarray:
    """Raised blocks (h, w) bool with the colours of the support and a surface along the lines of sight.

    Args:
        s: The crop, its raised pixels included.
        support: (h, w) bool, blocks of the support.
    """
    from scipy import ndimage
    from scipy.spatial import cKDTree

    known = s.raised & (np.linalg.norm(s.normal, axis=-1) > 0)
    rays = s.points - s.eye
    cosine = -(rays * s.normal).sum(axis=-1) / np.maximum(np.linalg.norm(rays, axis=-1), 1e-9)
    doubtful = s.raised & (~known | (cosine < GRAZING))
    sure = known & ~doubtful
    beside = support & ~ndimage.binary_dilation(s.raised, iterations=2)
    if not doubtful.any() or not sure.any() or not beside.any():
        return np.zeros(s.raised.shape, bool)
    rows, columns = np.indices(s.raised.shape)
    look = np.concatenate([s.lab, NEAR_LAB * np.stack([rows, columns], axis=-1)], axis=-1)
    samples = [look[where][:: max(1, int(where.sum()) // MOST)] for where in (beside, sure)]
    to_support, to_objects = (cKDTree(sample).query(look[doubtful])[0] for sample in samples)
    found = np.zeros(s.raised.shape, bool)
    found[doubtful] = to_support < ALIKE * to_objects
    return np.asarray(ndimage.binary_opening(found, np.ones((2, 2), bool)))
