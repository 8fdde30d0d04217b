"""Similarity registration of a whole model to its visible part.

Nearest-neighbour ICP with a free scale collapses, because all seen points find a partner when the model shrinks onto
them. Here only visible model points are used, both directions have equal weights, the worst pairs are trimmed, and the
scale has a prior.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import least_squares, lie, transforms


@dataclass(frozen=True)
class ScaledPose:
    """x_world = pose @ (scale * x_model)."""

    scale: float  # model units to metres
    pose: np.ndarray  # (4, 4) T_world_object, rigid

    def apply(self, points: np.ndarray) -> np.ndarray:
        """World positions of (N, 3) model points."""
        return transforms.apply(self.pose, self.scale * points)

    def unapply(self, points: np.ndarray) -> np.ndarray:
        """Model positions of (N, 3) world points."""
        return transforms.apply(transforms.invert(self.pose), points) / self.scale

    def moved(self, twist: np.ndarray, pivot: np.ndarray | None = None) -> ScaledPose:
        """The similarity after a twist (7,) that turns and scales about `pivot` (3,), by default its own origin."""
        return ScaledPose(
            *lie.retract_similarity(self.scale, self.pose, twist, self.pose[:3, 3] if pivot is None else pivot)
        )


Visible = Callable[[ScaledPose], tuple[np.ndarray, np.ndarray]]
"""Model-frame points (N, 3) and outward normals (N, 3) of the placed model that are visible to the camera."""

STILL = 1e-6
"""Step size at which the search ends, in metres, radians and log scale."""
HUBER = 4.0
"""Residual, in standard deviations, above which the influence of a pair is constant."""


@dataclass(frozen=True)
class Search:
    """Parameters of `icp`."""

    freedom: np.ndarray  # (7, K) basis of the allowed twists: lie.FREE, UPRIGHT or resting()
    scale: float  # centre of the scale prior
    scale_sigma: float  # its relative standard deviation
    noise_m: float  # standard deviation of a pair [m]: `planes.depth_sigma`
    iterations: int = 30
    keep: float = 0.98  # fraction of the pairs that remain after trimming
    point_weight: float = 0.15  # relative weight of point-to-point; constrains flat faces in their plane
    samples: float = 50.0  # effective number of independent measurements of all pairs


def icp(start: ScaledPose, visible: Visible, seen: np.ndarray, search: Search) -> ScaledPose:
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

    def step(now: ScaledPose, _: int) -> tuple[np.ndarray, ScaledPose] | None:
        points, normals = visible(now)
        if len(points) < 10:
            return None
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
        change, pivot = _step(placed[own], normals[own], target, weights, now.scale, search)
        return change, now.moved(np.append(change[:6], np.clip(change[6], -0.2, 0.2)), pivot)

    *_, found = least_squares.gauss_newton(start, step, range(search.iterations), STILL)
    return found


def _weights(distances: np.ndarray, search: Search) -> np.ndarray:
    """Huber weights that sum to one half."""
    weights = least_squares.huber(distances, HUBER * search.noise_m)
    return np.asarray(0.5 * weights / weights.sum())


def _trimmed(distances: np.ndarray, keep: float) -> np.ndarray:
    last = min(int(keep * len(distances)), len(distances) - 1)
    return np.asarray(distances <= np.partition(distances, last)[last])


def _step(
    placed: np.ndarray, normals: np.ndarray, target: np.ndarray, weights: np.ndarray, scale: float, search: Search
) -> tuple[np.ndarray, np.ndarray]:
    """Twist (7,) of the weighted pairs and the scale prior, in the allowed motions, and the point (3,) it is about."""
    pivot = placed.mean(axis=0)
    if not search.freedom[2].any():  # no motion along z
        pivot = pivot * [1.0, 1.0, 0.0]  # scaling about a point of the support preserves the contact
    arms = placed - pivot
    offsets = target - placed
    # Rows of both terms are stacked; matrix products are ten times as fast as contractions of (N, 3, 7).
    rows = np.concatenate([lie.point_to_plane_rows(arms, normals), lie.point_motions(arms).reshape(-1, 7)])
    trust = search.samples / search.noise_m**2
    each = trust * np.concatenate([weights, np.repeat(search.point_weight * weights, 3)])
    wanted = np.concatenate([(normals * offsets).sum(axis=1), offsets.reshape(-1)])
    known = np.append(np.full(6, np.inf), search.scale_sigma)
    expected = np.append(np.zeros(6), np.log(search.scale / scale))
    found = least_squares.normal(rows, wanted, each) + least_squares.prior(known, expected)
    return np.asarray(search.freedom @ found.within(search.freedom).shortest(1e-12)), pivot


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
    return np.array([lie.rotation(np.array([0.0, 0.0, span * k / count])) for k in range(count)])


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
