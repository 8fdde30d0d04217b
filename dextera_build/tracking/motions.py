"""Small motions of a pose.

A twist (6,) is a translation [m] and a rotation vector [rad] about the axes of the parent frame, as in
`geometry.uncertainty`: p = p0 + dp, R = Exp(dr) R0.
"""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import registration, transforms


def moved(pose: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """The pose (4, 4) after a twist (6,)."""
    return transforms.rigid(registration.rotation(twist[3:]) @ pose[:3, :3], pose[:3, 3] + twist[:3])


def between(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The twist (6,) that leads from one pose (4, 4) to another."""
    return np.append(second[:3, 3] - first[:3, 3], registration.rotation_vector(second[:3, :3] @ first[:3, :3].T))


def proper(pose: np.ndarray) -> np.ndarray:
    """The pose with the nearest rotation, because many products accumulate rounding errors."""
    u, _, vt = np.linalg.svd(pose[:3, :3])
    return transforms.rigid(u @ vt, pose[:3, 3])


def displacement(first: np.ndarray, second: np.ndarray, corners: np.ndarray) -> float:
    """Root mean square displacement [m] of points (N, 3) of the object between two of its poses (4, 4)."""
    apart = transforms.apply(first, corners) - transforms.apply(second, corners)
    return float(np.sqrt(np.square(apart).sum(axis=1).mean()))
