"""Poses of a tracked object: without rounding errors, and how far apart two of them are."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import transforms


def proper(pose: np.ndarray) -> np.ndarray:
    """The pose with the nearest rotation, because many products accumulate rounding errors."""
    u, _, vt = np.linalg.svd(pose[:3, :3])
    return transforms.rigid(u @ vt, pose[:3, 3])


def displacement(first: np.ndarray, second: np.ndarray, corners: np.ndarray) -> float:
    """Root mean square displacement [m] of points (N, 3) of the object between two of its poses (4, 4)."""
    apart = transforms.apply(first, corners) - transforms.apply(second, corners)
    return float(np.sqrt(np.square(apart).sum(axis=1).mean()))
