"""Similarity registration of a whole model to its visible part.

Nearest-neighbour ICP with a free scale collapses, because all seen points find a partner when the model shrinks onto
them. Here only visible model points are used, both directions have equal weights, the worst pairs are trimmed, and the
scale has a prior.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import transforms


@dataclass(frozen=True)
class Similarity:
    """x_world = pose @ (scale * x_model)."""

    scale: float  # model units to metres
    pose: np.ndarray  # (4, 4) T_world_object, rigid

    def apply(self, points: np.ndarray) -> np.ndarray:
        """World positions of (N, 3) model points."""
        return transforms.apply(self.pose, self.scale * points)

    def unapply(self, points: np.ndarray) -> np.ndarray:
        """Model positions of (N, 3) world points."""
        return transforms.apply(transforms.invert(self.pose), points) / self.scale


Visible = Callable[[Similarity], tuple[np.ndarray, np.ndarray]]
"""Model-frame points (N, 3) and outward normals (N, 3) of the placed model that are visible to the camera."""

FREE = np.eye(7)
"""Basis of all motions: rotation x y z, translation x y z, log scale."""
UPRIGHT = FREE[:, [2, 3, 4, 5, 6]]
"""Basis of the motions that keep the model's up axis."""
RESTING = FREE[:, [2, 3, 4, 6]]
"""Basis of the motions that keep the up axis and the contact with z = 0."""
HUBER = 4.0
"""Residual, in standard deviations, above which the influence of a pair is constant."""


@dataclass(frozen=True)
class Search:
    """Parameters of `icp`."""

    freedom: np.ndarray  # (7, K) basis of the allowed motions, one of FREE, UPRIGHT, RESTING
    scale: float  # centre of the scale prior
    scale_sigma: float  # its relative standard deviation
    iterations: int = 30
    keep: float = 0.98  # fraction of the pairs that remain after trimming
    point_weight: float = 0.15  # relative weight of point-to-point; constrains flat faces in their plane
    noise_m: float = 0.002  # standard deviation of a pair [m]
    samples: float = 50.0  # effective number of independent measurements of all pairs


def icp(start: Similarity, visible: Visible, seen: np.ndarray, search: Search) -> Similarity:
    """Bidirectional trimmed point-to-plane ICP over similarities.

    Args:
        start: Initial similarity.
        visible: Renders the model.
        seen: (N, 3) seen points in the world frame [m].
        search: See `Search`.

    Returns:
        The refined similarity, or the start if the model is not visible to the camera.
    """
    from scipy.spatial import KDTree

    tree = KDTree(seen)
    now = start
    for _ in range(search.iterations):
        points, normals = visible(now)
        if len(points) < 10:
            return now
        placed = now.apply(points)
        normals = normals @ now.pose[:3, :3].T
        forward, nearest = (np.asarray(part) for part in tree.query(placed))
        backward, owner = (np.asarray(part) for part in KDTree(placed).query(seen))
        keep = _trimmed(forward, search.keep)
        also = _trimmed(backward, search.keep)
        own = np.concatenate([np.flatnonzero(keep), owner[also]])
        target = np.concatenate([seen[nearest[keep]], seen[also]])
        # Pairs at the outline constrain flat faces within their plane, so distant ones are downweighted, not dropped.
        weights = np.concatenate([_weights(forward[keep], search), _weights(backward[also], search)])
        step = _step(placed[own], normals[own], target, weights, now.scale, search)
        now = _moved(now, step)
        if np.abs(step.motion).max() < 1e-6:
            break
    return now


def _weights(distances: np.ndarray, search: Search) -> np.ndarray:
    """Huber weights that sum to one half."""
    reach = HUBER * search.noise_m
    weights = np.minimum(1.0, reach / np.maximum(distances, 1e-12))
    return np.asarray(0.5 * weights / weights.sum())


@dataclass(frozen=True)
class _Step:
    pivot: np.ndarray  # (3,)
    motion: np.ndarray  # (7,) rotation vector, translation, log scale


def _trimmed(distances: np.ndarray, keep: float) -> np.ndarray:
    last = min(int(keep * len(distances)), len(distances) - 1)
    return np.asarray(distances <= np.partition(distances, last)[last])


def _step(
    placed: np.ndarray, normals: np.ndarray, target: np.ndarray, weights: np.ndarray, scale: float, search: Search
) -> _Step:
    """Gauss-Newton step of the weighted pairs and the scale prior, in the allowed motions."""
    pivot = placed.mean(axis=0)
    if search.freedom.shape[1] == RESTING.shape[1]:
        pivot = pivot * [1.0, 1.0, 0.0]  # scaling about a point of the support preserves the contact
    arms = placed - pivot
    offsets = target - placed
    # d placed / d motion = [-[arm]x, I, arm]
    zero = np.zeros(len(arms))
    x, y, z = arms.T
    jacobian = np.zeros((len(arms), 3, 7))
    jacobian[:, :, :3] = np.stack([[zero, z, -y], [-z, zero, x], [y, -x, zero]]).transpose(2, 0, 1)
    jacobian[:, :, 3:6] = np.eye(3)
    jacobian[:, :, 6] = arms
    # n . d placed, row by row
    along = np.column_stack([np.cross(arms, normals), normals, (arms * normals).sum(axis=1)])
    trust = search.samples / search.noise_m**2
    # Rows of both terms are stacked; matrix products are ten times as fast as contractions of (N, 3, 7).
    rows = np.concatenate([along, jacobian.reshape(-1, 7)])
    each = trust * np.concatenate([weights, np.repeat(search.point_weight * weights, 3)])
    wanted = np.concatenate([(normals * offsets).sum(axis=1), offsets.reshape(-1)])
    system = rows.T @ (rows * each[:, None])
    right = rows.T @ (each * wanted)
    system[6, 6] += 1.0 / search.scale_sigma**2
    right[6] += np.log(search.scale / scale) / search.scale_sigma**2
    basis = search.freedom
    reduced = np.linalg.lstsq(basis.T @ system @ basis, basis.T @ right, rcond=1e-12)[0]
    return _Step(pivot, np.asarray(basis @ reduced))


def _moved(now: Similarity, step: _Step) -> Similarity:
    growth = float(np.exp(np.clip(step.motion[6], -0.2, 0.2)))
    turn = rotation(step.motion[:3])
    rotated = turn @ now.pose[:3, :3]
    place = growth * turn @ (now.pose[:3, 3] - step.pivot) + step.pivot + step.motion[3:6]
    return Similarity(now.scale * growth, transforms.rigid(rotated, place))


def rotation(vector: np.ndarray) -> np.ndarray:
    """(3, 3) rotation of a rotation vector [rad] (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    cross = transforms.cross_matrix(vector / angle)
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)


def rotation_vector(turn: np.ndarray) -> np.ndarray:
    """(3,) axis times angle [rad] of a (3, 3) rotation."""
    angle = transforms.angle(turn)
    skew = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    if angle < 1e-9:
        return skew / 2.0
    if np.pi - angle < 1e-4:
        # Near a half turn the skew part vanishes; the axis is the eigenvector of the symmetric part.
        axis = np.linalg.eigh(turn + turn.T)[1][:, -1]
        return np.asarray(axis * angle * (1.0 if axis @ skew >= 0 else -1.0))
    return np.asarray(skew * angle / (2.0 * np.sin(angle)))


def cube_rotations() -> np.ndarray:
    """The 24 rotations (24, 3, 3) that permute and flip axes."""
    found = []
    for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)):
        for signs in np.ndindex(2, 2, 2):
            matrix = np.eye(3)[list(order)] * (1.0 - 2.0 * np.array(signs))[:, None]
            if np.linalg.det(matrix) > 0.0:
                found.append(matrix)
    return np.array(found)


def yaws(count: int, span: float = 2.0 * np.pi) -> np.ndarray:
    """`count` equally spaced rotations about z over `span` [rad], (count, 3, 3)."""
    return np.array([rotation(np.array([0.0, 0.0, span * k / count])) for k in range(count)])


def spread_rotations(count: int) -> np.ndarray:
    """`count` rotations (count, 3, 3) distributed over SO(3): super-Fibonacci spirals (Alexa, CVPR 2022)."""
    phi, psi = np.sqrt(2.0), 1.533751168755204288118041
    s = np.arange(count) + 0.5
    r, big = np.sqrt(s / count), np.sqrt(1.0 - s / count)
    a, b = 2.0 * np.pi * s / phi, 2.0 * np.pi * s / psi
    x, y, z, w = r * np.sin(a), r * np.cos(a), big * np.sin(b), big * np.cos(b)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)
