"""Rigid registration of one sight to another by their common surface, from many starts."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dextera_build.geometry import least_squares, lie, transforms

from .clouds import Cloud, Eye, Sight

ALIKE = 0.8
"""Smallest cosine between two normals of the same surface."""
HELD = 1.0
"""Weight of the fraction of matched borders in the score, relative to that of matched surface points."""
BORDERS = 2.0
"""Weight of all borders relative to all surface points; only borders constrain a flat face within its plane."""


@dataclass(frozen=True)
class Pairs:
    """Points with their corresponding planes."""

    own: np.ndarray  # (N,) index in the source
    partner: np.ndarray  # (N, 3) a point of the plane [m]
    normal: np.ndarray  # (N, 3)


class Target:
    """The sight to register to."""

    def __init__(self, sight: Sight) -> None:
        from scipy.spatial import KDTree

        self.sight = sight
        self._trees: tuple[Any, Any] = (
            KDTree(sight.inner.points),
            KDTree(sight.border.points) if len(sight.border) else None,
        )

    def surfaces(self, moved: Cloud, gate: float) -> Pairs:
        """Correspondences of surface points within `gate` [m]."""
        return _pairs(moved, self.sight.inner, self._trees[0], gate)

    def borders(self, moved: Cloud, gate: float) -> Pairs:
        """Correspondences of border points within `gate` [m]."""
        return _pairs(moved, self.sight.border, self._trees[1], gate)

    def explained(self, moved: Cloud, gate: float) -> np.ndarray:
        """Which surface points of `moved` are on this surface within `gate` [m], (N,) bool.

        The tangential distance may be larger, because both surfaces are sampled.
        """
        if not len(moved):
            return np.zeros(0, bool)
        cloud = self.sight.inner
        distance, nearest = self._trees[0].query(moved.points, k=4, distance_upper_bound=3.0 * gate + 0.004)
        inside = np.isfinite(distance)
        safe = np.where(inside, nearest, 0)
        offset = ((moved.points[:, None] - cloud.points[safe]) * cloud.normals[safe]).sum(axis=-1)
        like = (moved.normals[:, None] * cloud.normals[safe]).sum(axis=-1) > ALIKE
        return np.asarray((inside & like & (np.abs(offset) < gate)).any(axis=1))

    def score(self, moved: Sight) -> float:
        """Fraction of `moved` on this sight: surface points, and borders on borders."""
        sigma = max(self.sight.sigma, moved.sigma)
        on = float(self.explained(moved.inner, 2.5 * sigma).sum())
        found = self.borders(moved.border, 0.004 + 2.0 * sigma)
        return on + HELD * len(found.own) * len(moved.inner) / max(1, len(moved.border))


def _pairs(moved: Cloud, cloud: Cloud, tree: Any, gate: float) -> Pairs:
    if tree is None or not len(moved):
        return Pairs(np.zeros(0, int), np.zeros((0, 3)), np.zeros((0, 3)))
    distance, nearest = tree.query(moved.points, distance_upper_bound=gate)
    own = np.flatnonzero(np.isfinite(distance))
    other = nearest[own]
    like = (moved.normals[own] * cloud.normals[other]).sum(axis=1) > ALIKE
    return Pairs(own[like], cloud.points[other[like]], cloud.normals[other[like]])


def laid(start: np.ndarray, source: Sight, target: Target, gates: Iterable[float], freedom: np.ndarray) -> np.ndarray:
    """Registration of surfaces and borders with a shrinking gate; returns the (4, 4) motion of `source`.

    Args:
        start: (4, 4) first guess.
        source: The sight to move.
        target: The sight to register to.
        gates: Largest distance of a pair in each step [m].
        freedom: (6, K) basis of the allowed motions.
    """

    def step(now: np.ndarray, gate: float) -> tuple[np.ndarray, np.ndarray] | None:
        moved = source.moved(now)
        on, at = target.surfaces(moved.inner, gate), target.borders(moved.border, gate)
        if len(on.own) < 8:
            return None
        change, pivot = _step(moved, on, at, gate, freedom)
        return change, lie.motion(change, pivot) @ now

    *_, found = least_squares.gauss_newton(start, step, gates)
    return found


def _step(moved: Sight, on: Pairs, at: Pairs, gate: float, freedom: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One Gauss-Newton step (6,) with Tukey weights, and the point (3,) that it is about."""
    points = np.concatenate([moved.inner.points[on.own], moved.border.points[at.own]])
    partner, normal = np.concatenate([on.partner, at.partner]), np.concatenate([on.normal, at.normal])
    each = np.concatenate(
        [np.full(len(on.own), 1.0), np.full(len(at.own), BORDERS * len(on.own) / max(1, len(at.own)))]
    )
    pivot = points.mean(axis=0)
    offset = ((partner - points) * normal).sum(axis=1)
    weight = each * least_squares.tukey(offset, gate)
    found = least_squares.normal(lie.point_to_plane_rows(points - pivot, normal)[:, :6], offset, weight)
    # Unobservable directions are left unchanged.
    loose = 1e-6 * weight.sum() * np.array([1.0] * 3 + [1e-2] * 3)
    found += least_squares.Normal(np.diag(loose), np.zeros(6))
    return np.asarray(freedom @ found.within(freedom).solved()), pivot


def narrow(sigma: float) -> list[float]:
    """Gates of the last steps [m]."""
    return [0.007, 0.006, 0.005, 0.004] + [max(0.002, 3.5 * sigma)] * 6


WIDE = (0.05, 0.04, 0.03, 0.03, 0.02, 0.02, 0.015, 0.01, 0.008)
"""Gates of the first steps [m]."""
CLOSE = (0.02, 0.016, 0.012, 0.012, 0.01, 0.01, 0.008)
"""Gates of the first steps for starts that are near [m]."""


Worth = Callable[[np.ndarray], float]
"""Plausibility of a (4, 4) motion, a factor of its score."""


def _equal(motion: np.ndarray) -> float:
    return 1.0


def best(
    starts: list[np.ndarray],
    source: Sight,
    target: Target,
    freedom: np.ndarray,
    keep: int = 6,
    worth: Worth = _equal,
    close: tuple[np.ndarray, ...] = (),
) -> np.ndarray:
    """The best-scoring (4, 4) registration of `source` to `target`; ties go to the earlier start.

    Starts in `close` use near pairs only, which reduces the influence of parts that moved.
    """
    thin = source.thinned(350, 150)
    found = [laid(start, thin, target, WIDE, freedom) for start in starts]
    found += [laid(start, thin, target, CLOSE, freedom) for start in close]
    scores = [-target.score(thin.moved(motion)) * worth(motion) for motion in found]
    order = _different(np.argsort(scores, kind="stable"), found, source, keep)
    medium = source.thinned(1500, 500)
    gates = narrow(source.sigma)
    fine = [laid(laid(found[k], medium, target, gates, freedom), medium, target, gates, lie.RIGID) for k in order]
    # The source should also cover the target; a part that slid along itself does not.
    back, other = Target(medium), target.sight.thinned(1500, 500)
    share = len(medium.inner) / max(1, len(other.inner))
    scores = [
        (target.score(medium.moved(motion)) + share * back.score(other.moved(transforms.invert(motion))))
        * worth(motion)
        for motion in fine
    ]
    return fine[int(np.argmax(scores))]


def _different(order: np.ndarray, motions: list[np.ndarray], source: Sight, keep: int) -> list[int]:
    """The first `keep` motions with distinct results."""
    corners = source.inner.thinned(8).points
    chosen: list[int] = []
    for k in order:
        placed = transforms.apply(motions[k], corners)
        apart = [np.abs(placed - transforms.apply(motions[other], corners)).max() > 0.004 for other in chosen]
        if all(apart):
            chosen.append(int(k))
        if len(chosen) == keep:
            break
    return chosen


def clear(eye: Eye | None, motion: np.ndarray, points: np.ndarray) -> float:
    """Factor for (4, 4) motions of points (N, 3): no point may be in observed empty space.

    It locates the ends of a part to the pixel, where surfaces and borders do not constrain a bar along its axis.
    """
    return 1.0 if eye is None else (1.0 - eye.empty(transforms.apply(motion, points))) ** 4
