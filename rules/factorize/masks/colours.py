"""Comparison of the colours of two regions of a photograph."""

from __future__ import annotations

import numpy as np

SAMPLES = 2000
"""About as many colours of a region are compared with others."""


def distances(lab: np.ndarray, of: np.ndarray, to: np.ndarray, samples: int = SAMPLES) -> np.ndarray:
    """Distance (N,) of the colours of one region from the nearest colour of another one [CIE Lab].

    Args:
        lab: (H, W, 3) CIE L*a*b*.
        of: (H, W) bool, N pixels.
        to: (H, W) bool, the other region, which is not empty.
        samples: Least number of its colours that are looked at, evenly spaced, if it has as many.
    """
    from scipy.spatial import cKDTree

    some = lab[to][:: max(1, int(to.sum()) // samples)]
    return np.asarray(cKDTree(some).query(lab[of])[0])
