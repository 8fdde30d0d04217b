"""Rigid motions that a file states."""

from __future__ import annotations

import numpy as np

from dextera_build.tracking.motions import proper

ROUNDED = 1e-3
"""Largest error of an entry of a rotation that rounding explains."""


def stated(told: object) -> np.ndarray:
    """The rigid motion (4, 4) nearest to a matrix of rounded numbers.

    Raises:
        ValueError: It is no rigid motion.
    """
    try:
        matrix = np.array(told, np.float64)
    except (TypeError, ValueError):
        raise ValueError("no numbers") from None
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise ValueError("no 4 x 4 numbers")
    found = proper(matrix)
    if np.abs(found - matrix).max() > ROUNDED or np.linalg.det(found[:3, :3]) < 0:
        raise ValueError("no rigid motion")
    return found
