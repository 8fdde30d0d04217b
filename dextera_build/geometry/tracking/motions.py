"""Small motions of a pose, and how fast a pose changes.

A twist (6,) is a translation [m] and a rotation vector [rad] about the axes of the parent frame, as in
`geometry.uncertainty`: p = p0 + dp, R = Exp(dr) R0.
"""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import transforms


def rotation(vector: np.ndarray) -> np.ndarray:
    """(3, 3) rotation of a rotation vector (3,) [rad] (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.asarray(np.eye(3) + transforms.cross_matrix(vector))
    cross = transforms.cross_matrix(vector / angle)
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)


def vector(turn: np.ndarray) -> np.ndarray:
    """Rotation vector (3,) [rad] of a (3, 3) rotation by less than pi."""
    skew = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    length = float(np.linalg.norm(skew))
    if length < 1e-12:
        return skew / 2
    return np.asarray(skew / length * transforms.angle(turn))


def moved(pose: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """The pose (4, 4) after a twist (6,)."""
    return transforms.rigid(rotation(twist[3:]) @ pose[:3, :3], pose[:3, 3] + twist[:3])


def between(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The twist (6,) that leads from one pose (4, 4) to another."""
    return np.append(second[:3, 3] - first[:3, 3], vector(second[:3, :3] @ first[:3, :3].T))


def proper(pose: np.ndarray) -> np.ndarray:
    """The pose with the nearest rotation: many products round it off."""
    u, _, vt = np.linalg.svd(pose[:3, :3])
    return transforms.rigid(u @ vt, pose[:3, 3])


def displacement(first: np.ndarray, second: np.ndarray, corners: np.ndarray) -> float:
    """Root mean square way [m] of points (N, 3) of the object between two of its poses (4, 4)."""
    apart = transforms.apply(first, corners) - transforms.apply(second, corners)
    return float(np.sqrt(np.square(apart).sum(axis=1).mean()))
