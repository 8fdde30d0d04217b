"""Poses as seven numbers, position [m] and unit quaternion w x y z, and the same poses as (4, 4) matrices."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import quaternions, transforms


def to_matrix(pose: np.ndarray) -> np.ndarray:
    """(4, 4) float64 motion of a pose (7,)."""
    return transforms.rigid(quaternions.to_matrix(pose[3:].astype(np.float64)), pose[:3].astype(np.float64))


def from_matrix(motion: np.ndarray) -> np.ndarray:
    """Pose (7,) of a rigid (4, 4) motion; its quaternion has w >= 0."""
    return np.append(motion[:3, 3], quaternions.from_matrix(motion[:3, :3]))
