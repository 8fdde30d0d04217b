"""Rotations, rigid motions and similarities as Lie groups: exponentials, logarithms, retractions and adjoints.

A twist (6,) is a translation [m], then a rotation vector [rad], about the axes of the parent frame; of a similarity
(7,), the logarithm of the scale follows. Nothing else has another order. A retraction changes position and rotation
apart, p = p0 + dp, R = Exp(dr) R0, s = s0 exp(dl), as covariances do (`geometry.uncertainty`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dextera_build.geometry import transforms

FREE = np.eye(7)
"""Basis of all twists of a similarity: translation x y z, rotation vector x y z, log scale."""
UPRIGHT = FREE[:, [0, 1, 2, 5, 6]]
"""Basis of those that keep the up axis."""
RIGID = np.eye(6)
"""Basis of all twists of a rigid motion."""
PLANAR = RIGID[:, [0, 1, 5]]
"""Basis of those along the plane z = 0: translation x y, rotation about z."""


def resting(height_m: float = 0.0) -> np.ndarray:
    """Basis (7, 4) of the twists that keep the up axis and the contact with z = 0.

    Args:
        height_m: Height of the point that the twists turn and scale about [m].
    """
    basis = FREE[:, [0, 1, 5, 6]].copy()
    basis[2, 3] = height_m
    return basis


def rotation(vector: np.ndarray) -> np.ndarray:
    """(3, 3) rotation of a rotation vector [rad]: the exponential of SO(3)."""
    angle = float(np.linalg.norm(vector))
    return np.eye(3) if angle < 1e-12 else about(vector / angle, angle)


def about(axis: np.ndarray, angle: float) -> np.ndarray:
    """(3, 3) rotation by `angle` [rad] about a unit `axis` (Rodrigues)."""
    cross = transforms.cross_matrix(axis)
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)


def about_z(angle: float) -> np.ndarray:
    """(3, 3) rotation by `angle` [rad] about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation_vector(turn: np.ndarray) -> np.ndarray:
    """(3,) axis times angle [rad] of a (3, 3) rotation: the logarithm of SO(3)."""
    angle = transforms.angle(turn)
    skew = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    if angle < 1e-9:
        return skew / 2.0
    if np.pi - angle < 1e-4:
        # Near a half turn the skew part vanishes; the axis is the eigenvector of the symmetric part.
        axis = np.linalg.eigh(turn + turn.T)[1][:, -1]
        return np.asarray(axis * angle * (1.0 if axis @ skew >= 0 else -1.0))
    return np.asarray(skew * angle / (2.0 * np.sin(angle)))


def retract(pose: np.ndarray, twist: np.ndarray | Sequence[float]) -> np.ndarray:
    """The pose (4, 4) after a twist (6,), which rotates it about its own origin."""
    change = np.asarray(twist, np.float64)
    return transforms.rigid(rotation(change[3:]) @ pose[:3, :3], pose[:3, 3] + change[:3])


def between(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The twist (6,) that leads from one pose (4, 4) to another: the inverse of `retract`."""
    return np.append(second[:3, 3] - first[:3, 3], rotation_vector(second[:3, :3] @ first[:3, :3].T))


def retract_similarity(
    scale: float, pose: np.ndarray, twist: np.ndarray, pivot: np.ndarray
) -> tuple[float, np.ndarray]:
    """Scale and pose (4, 4) of x' = pose @ (scale * x) after a twist (7,) that turns and scales about `pivot` (3,)."""
    growth, turn = float(np.exp(twist[6])), rotation(twist[3:6])
    place = growth * turn @ (pose[:3, 3] - pivot) + pivot + twist[:3]
    return scale * growth, transforms.rigid(turn @ pose[:3, :3], place)


def motion(twist: np.ndarray, pivot: np.ndarray) -> np.ndarray:
    """(4, 4) motion by a twist (6,) that rotates about `pivot` (3,)."""
    turn = rotation(twist[3:])
    return transforms.rigid(turn, twist[:3] + pivot - turn @ pivot)


def turned(axis: np.ndarray, origin: np.ndarray, angle: float) -> np.ndarray:
    """(4, 4) rotation by `angle` [rad] about the line through `origin` along unit `axis`."""
    turn = rotation(axis * angle)
    return transforms.rigid(turn, origin - turn @ origin)


def adjoint(arm: np.ndarray, size: int = 6) -> np.ndarray:
    """(6, 6) or (7, 7) map of a twist about a point to that about the point at `arm` (3,) from it [m]."""
    found = np.eye(size)
    found[:3, 3:6] = -transforms.cross_matrix(arm)
    if size == 7:
        found[:3, 6] = arm
    return found


def point_motions(arms: np.ndarray) -> np.ndarray:
    """Derivatives (N, 3, 7) of points by a twist of their body, which turns and scales about a point.

    Args:
        arms: (N, 3) from that point to the points [m].
    """
    found = np.zeros((len(arms), 3, 7))
    found[:, :, :3] = np.eye(3)
    found[:, :, 3:6] = -transforms.cross_matrix(arms)
    found[:, :, 6] = arms
    return found


def point_to_plane_rows(arms: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Derivatives (N, 7) of the distances of points along `normals` (N, 3); `arms` as in `point_motions`."""
    return np.column_stack([normals, np.cross(arms, normals), (arms * normals).sum(axis=1)])
