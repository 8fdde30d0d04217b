"""Stamped poses in text files: rounded quaternions, and upper triangles of covariances."""

from __future__ import annotations

import numpy as np

UPPER = np.triu_indices(6)
"""Indices of the 21 numbers of a symmetric (6, 6) matrix in files, row by row."""


def unit(poses: np.ndarray) -> np.ndarray:
    """Poses (N, 7) from a file, with rounded quaternions normalised.

    Raises:
        ValueError: A length differs from 1 by more than 1 %, which is no rounding error.
    """
    length = np.linalg.norm(poses[:, 3:], axis=1)
    bad = np.flatnonzero(np.abs(length - 1) > 0.01)
    if len(bad):
        raise ValueError(f"the quaternion of pose {bad[0] + 1} has length {length[bad[0]]:.4g} instead of 1")
    # Exact ones are unchanged.
    length = np.where(np.abs(length - 1) > 1e-12, length, 1.0)
    return np.hstack([poses[:, :3], poses[:, 3:] / length[:, None]])


def full(upper: np.ndarray) -> np.ndarray:
    """Covariances (N, 6, 6) of their upper triangles (N, 21), row by row."""
    found = np.zeros((len(upper), 6, 6))
    found[:, UPPER[0], UPPER[1]] = upper
    found[:, UPPER[1], UPPER[0]] = upper
    return found
