"""Unit quaternions in the order w, x, y, z (MuJoCo, USD); SciPy and ROS write x, y, z, w."""

from __future__ import annotations

import numpy as np


def from_matrix(rotation: np.ndarray) -> np.ndarray:
    """(4,) unit quaternion with w >= 0 of a (3, 3) rotation (Bar-Itzhack 2000: robust to slightly noisy ones)."""
    m = rotation.astype(np.float64)
    vector = np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    k = np.zeros((4, 4))
    k[0, 0] = np.trace(m)
    k[0, 1:] = k[1:, 0] = vector
    k[1:, 1:] = m + m.T - np.trace(m) * np.eye(3)
    quaternion = np.linalg.eigh(k / 3.0)[1][:, -1]
    # Half turns have w = 0: the first nonzero component determines the sign, so that equal rotations have equal bytes.
    leading = quaternion[int(np.argmax(np.abs(quaternion) > 1e-9))]
    return np.asarray(quaternion if leading > 0 else -quaternion)


def from_matrices(rotations: np.ndarray) -> np.ndarray:
    """(N, 4) unit quaternions of (N, 3, 3) rotations, of either sign (Shepperd 1978: by the largest component)."""
    x, y, z = np.moveaxis(np.diagonal(rotations, axis1=1, axis2=2), -1, 0)
    squares = 1 + np.stack([x + y + z, x - y - z, y - x - z, z - x - y], axis=1)  # four times those of w, x, y, z
    lead = squares.argmax(axis=1)
    above, below = (
        np.stack([each[:, i, j] for i, j in ((2, 1), (0, 2), (1, 0))]) for each in (rotations, rotations.swapaxes(1, 2))
    )
    (a, b, c), (d, e, f) = above - below, above + below
    # Four times each product of two components, row by row.
    products = np.array(
        [[squares[:, 0], a, b, c], [a, squares[:, 1], f, e], [b, f, squares[:, 2], d], [c, e, d, squares[:, 3]]]
    )
    found = products[lead, :, np.arange(len(lead))]
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def to_matrix(quaternion: np.ndarray) -> np.ndarray:
    """(3, 3) rotation of a (4,) quaternion of any nonzero length."""
    return _rows(*(quaternion / np.linalg.norm(quaternion)))


def to_matrices(quaternions: np.ndarray) -> np.ndarray:
    """(..., 3, 3) rotations of (..., 4) quaternions of any nonzero length; NaN where one is NaN."""
    unit = quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True)
    return np.moveaxis(_rows(*np.moveaxis(unit, -1, 0)), (0, 1), (-2, -1))


def _rows(w: np.ndarray, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Rotations (3, 3, ...) of unit quaternions whose components have any shape."""
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def multiply(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Products (..., 4) of quaternions (..., 4): the rotation `second`, then `first`."""
    w, x, y, z = np.moveaxis(np.asarray(first), -1, 0)
    a, b, c, d = np.moveaxis(np.asarray(second), -1, 0)
    parts = (
        w * a - x * b - y * c - z * d,
        w * b + x * a + y * d - z * c,
        w * c - x * d + y * a + z * b,
        w * d + x * c - y * b + z * a,
    )
    return np.stack(parts, axis=-1)


def slerp(first: np.ndarray, second: np.ndarray, share: float) -> np.ndarray:
    """The unit quaternion (4,) at fraction `share` of the shorter arc between two rotations (Shoemake 1985)."""
    near = second if float(first @ second) >= 0 else -second
    angle = 2 * np.arctan2(np.linalg.norm(near - first), np.linalg.norm(near + first))
    if angle < 1e-9:
        mixed = first + share * (near - first)
    else:
        mixed = (np.sin((1 - share) * angle) * first + np.sin(share * angle) * near) / np.sin(angle)
    return np.asarray(mixed / np.linalg.norm(mixed))
