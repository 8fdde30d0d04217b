"""Rigid and similarity motions as homogeneous matrices; T_a_b maps coordinates in b to coordinates in a."""

from __future__ import annotations

import numpy as np


def rigid(rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """(4, 4) float64 from a (3, 3) rotation and a (3,) translation [m]."""
    matrix = np.zeros((4, 4))
    matrix[:3, :3] = rotation
    matrix[:3, 3] = translation
    matrix[3, 3] = 1.0
    return matrix


def invert(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a rigid (4, 4) motion, by transposition."""
    rotation = matrix[:3, :3]
    return rigid(rotation.T, -rotation.T @ matrix[:3, 3])


def apply(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Transform (..., 3) points by a (4, 4) motion."""
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])


def angle(rotation: np.ndarray) -> float:
    """Rotation angle of a (3, 3) rotation [rad], accurate near 0 and pi."""
    skew = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    return float(np.arctan2(np.linalg.norm(skew), np.trace(rotation) - 1.0))


def angles(rotations: np.ndarray) -> np.ndarray:
    """Rotation angles (N,) of (N, 3, 3) rotations [rad], accurate near 0 and pi."""
    # Entry by entry, because `np.trace` and indices of several entries take longer for a few rotations.
    r = rotations.transpose(1, 2, 0)
    x, y, z = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    return np.asarray(np.arctan2(np.sqrt(x * x + y * y + z * z), r[0, 0] + r[1, 1] + r[2, 2] - 1.0))


def cross_matrix(vectors: np.ndarray) -> np.ndarray:
    """(..., 3, 3) matrices whose products with v are `vectors` (..., 3) x v."""
    found = np.zeros((*vectors.shape, 3))
    for row, (across, down) in enumerate(((1, 2), (2, 0), (0, 1))):
        found[..., down, across], found[..., across, down] = vectors[..., row], -vectors[..., row]
    return found


def umeyama(source: np.ndarray, target: np.ndarray, *, with_scale: bool = True) -> tuple[float, np.ndarray]:
    """Least-squares similarity target ~ s R source + t (Umeyama 1991), never a reflection.

    Args:
        source: (N, 3) points.
        target: (N, 3) points, same order.
        with_scale: False fixes the scale at 1.

    Returns:
        Scale s, and the rigid part as a (4, 4) matrix [R t], to be applied after the scale.
    """
    middle_s, middle_t = source.mean(axis=0), target.mean(axis=0)
    x, y = source - middle_s, target - middle_t
    u, d, vt = np.linalg.svd(y.T @ x / len(x))
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    rotation = u @ sign @ vt
    # The reflection sign must be included in the scale, too, or noise on flat data inflates it.
    scale = float(np.trace(np.diag(d) @ sign) / (x**2).sum(axis=1).mean()) if with_scale else 1.0
    return scale, rigid(rotation, middle_t - scale * rotation @ middle_s)


def rotation_between(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Smallest (3, 3) rotation that maps direction `source` to direction `target`, both (3,)."""
    a, b = source / np.linalg.norm(source), target / np.linalg.norm(target)
    cosine = float(a @ b)
    if cosine < -1.0 + 1e-12:
        helper = np.eye(3)[int(np.argmin(np.abs(a)))]
        axis = np.cross(a, helper)
        axis /= np.linalg.norm(axis)
        return np.asarray(2.0 * np.outer(axis, axis) - np.eye(3))
    cross = cross_matrix(np.cross(a, b))
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + cosine))
