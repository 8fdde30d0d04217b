"""Motion of a part between two sights: starting poses of the search, and tests of the result."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import lie, transforms

from . import portions
from .clouds import Cloud, Sight
from .matching import Target, Worth, best, clear
from .plausible import Plausible
from .screw import LEAST_TURN, Screw
from .standing import SOME

LEAST_SHARE = 0.02
"""Smallest fraction of the seen points that belong to a moved part."""
LEAST_EXPLAINED = 0.2
"""Smallest fraction of a moved part's points that the second sight confirms, of those that it would show."""
TURNS_DEG = (12, 25, 40, 60, 80, 105, 130)
"""Rotations that a search starts with, in both directions [deg]."""
REACH_M = 0.012
"""Largest distance of neighbours in a cluster that a search starts from [m]."""
UNMOVED_M = 0.008
"""Displacement along itself that a surface may have without being detected [m]."""
BESIDE_M = 0.02
"""Points within this distance of a moved part belong to it [m]."""
LARGEST_RESIDUAL = 1.5
"""Largest accepted residual of a part, in standard deviations of a point."""
LARGEST_EMPTY = 0.15
"""Largest accepted fraction of a part in observed empty space of the second sight."""
LEAST_SURE = 0.5
"""Smallest fraction of a part that the second sight confirms at its new pose, of the points that it would show."""


@dataclass(frozen=True)
class Open:
    """Points that would be visible in the other state, too, if they had not moved."""

    first: Sight
    second: Sight
    stayed: np.ndarray  # (4, 4) motion from the first world to the second
    first_points: np.ndarray  # (N,) bool
    second_points: np.ndarray  # (M,) bool

    def clear(self, part: np.ndarray, shown: np.ndarray) -> Worth:
        """A factor for motions of points (N, 3), see `matching.clear`, judged in both sights.

        Of the second sight's points `shown` (M, 3), those next to the moved part are used.
        """
        from scipy.spatial import KDTree

        tree = KDTree(part)

        def factor(motion: np.ndarray) -> float:
            back = transforms.invert(motion)
            beside = tree.query(transforms.apply(back, shown), distance_upper_bound=BESIDE_M)[0] < BESIDE_M
            home = transforms.invert(motion @ self.stayed)
            return clear(self.second.eye, motion, part) * clear(self.first.eye, home, shown[beside])

        return factor

    @classmethod
    def of(cls, first: Sight, second: Sight, stayed: np.ndarray) -> Open:
        """Points hidden from neither camera, where `stayed` (4, 4) maps the first world to the second."""
        mine, theirs = np.ones(len(first.inner), bool), np.ones(len(second.inner), bool)
        if second.eye is not None:
            mine = ~second.eye.hides(transforms.apply(stayed, first.inner.points))
        if first.eye is not None:
            theirs = ~first.eye.hides(transforms.apply(transforms.invert(stayed), second.inner.points))
        return cls(first, second, stayed, mine, theirs)


def moved(here: Sight, labels: np.ndarray, motions: list[np.ndarray], sights: Open) -> np.ndarray | None:
    """The motion of the largest part that no motion found so far explains, or None."""
    least = max(portions.LEAST_POINTS, int(LEAST_SHARE * len(here.inner)))
    second = sights.second
    rest = portions.inside(here.inner, labels < 0)
    known = np.zeros(len(second.inner), bool)
    for number, motion in enumerate(motions):
        mine = portions.part(here, labels, number).moved(motion)
        if len(mine.inner):
            laid_on = Target(mine)
            known |= laid_on.explained(second.inner, 3.0 * second.sigma)
    left = portions.inside(second.inner, ~known & sights.second_points)
    if rest.sum() < least or left.sum() < least:
        return None
    around = portions.part(here, labels, 0).inner if (labels == 0).any() else here.inner
    target = Target(portions.with_borders(second, portions.near(second.inner, left)))
    for piece in portions.pieces(here.inner, rest, least):
        shown = piece & sights.first_points
        if shown.sum() < portions.LEAST_POINTS:
            continue
        source = portions.with_borders(here, shown)
        found = _laid(source, here.inner.some(piece), target, around, sights, left)
        if found is not None:
            return found
    return None


def _laid(
    source: Sight, piece: Cloud, target: Target, around: Cloud, sights: Open, left: np.ndarray
) -> np.ndarray | None:
    """The motion that registers a piece to unexplained points of the second sight, or None.

    Args:
        source: The points of the piece that the second sight would show if it had not moved.
        piece: All points of the piece.
        target: Unexplained points of the second sight, and points near them.
        around: The part that did not move.
        sights: Both sights.
        left: (M,) bool, unexplained points of the second sight.
    """
    second = sights.second
    plausible = Plausible(piece, around)
    clear = sights.clear(source.inner.thinned(SOME).points, target.sight.inner.thinned(SOME).points)
    starts = _starts(piece, target.sight.inner, around)
    motion = best(starts, source, target, lie.RIGID, 12, lambda each: plausible(each) * clear(each))
    moved = source.inner.moved(motion)
    explained = target.explained(moved, 3.0 * source.sigma)
    shown = np.ones(len(moved), bool) if second.eye is None else ~second.eye.hides(moved.points)
    whole = Sight(piece.moved(motion), source.border.some(np.zeros(0, int)), source.sigma)
    covered = Target(whole).explained(second.inner.some(left), 3.0 * source.sigma)
    enough = (
        explained.sum() >= portions.LEAST_POINTS
        and explained[shown].mean() >= LEAST_EXPLAINED
        # An edge on a face does not constrain the face's motion along its plane, and other parts may have moved, too.
        and covered.mean() >= 0.7 * LEAST_EXPLAINED
    )
    return motion if enough and plausible.possible(motion, UNMOVED_M) else None


def _starts(source: Cloud, target: Cloud, around: Cloud) -> list[np.ndarray]:
    """Rotations about three axes, one of them vertical: between clusters of both clouds, and at possible hinges."""
    facing = np.concatenate([source.normals, around.normals])
    level = facing[np.abs(facing[:, 2]) < 0.3][:, :2]
    if len(level) > 30:
        double = np.exp(4j * np.angle(level[:, 0] + 1j * level[:, 1])).sum()
        heading = float(np.angle(double)) / 4.0
    else:
        flat = source.points[:, :2] - source.points[:, :2].mean(axis=0)
        heading = float(np.arctan2(*np.linalg.svd(flat, full_matrices=False)[2][0][::-1]))
    along = np.array([np.cos(heading), np.sin(heading), 0.0])
    axes = np.stack([np.array([0.0, 0.0, 1.0]), along, np.array([-along[1], along[0], 0.0])])
    turns = [lie.rotation(axis * s * np.radians(a)) for axis in axes for a in TURNS_DEG for s in (1, -1)]
    between = [
        transforms.rigid(turn, there - turn @ here)
        for here in _middles(source)
        for there in _middles(target)
        for turn in [np.eye(3), *turns]
    ]
    return between + [
        transforms.rigid(turn, pivot - turn @ pivot)
        for k, axis in enumerate(axes)
        for pivot in _pivots(source, around, axes, k)
        for turn in turns[k * 2 * len(TURNS_DEG) : (k + 1) * 2 * len(TURNS_DEG)]
    ]


def _pivots(source: Cloud, around: Cloud, axes: np.ndarray, which: int) -> list[np.ndarray]:
    """Points on lines along one of the axes (3, 3) about which the source may rotate."""
    from scipy.spatial import KDTree

    local = source.points @ axes.T
    low, middle, high = np.quantile(local, [0.02, 0.5, 0.98], axis=0)
    first, second = (k for k in range(3) if k != which)
    corners = []
    for a in (low, high):
        for b in (low, high):
            corner = middle.copy()
            corner[first], corner[second] = a[first], b[second]
            corners.append(corner @ axes)
    if not len(around):
        return corners
    gap = np.asarray(KDTree(around.points).query(source.points)[0])
    return [*corners, source.points[gap <= np.quantile(gap, 0.1)].mean(axis=0)]


def _middles(cloud: Cloud) -> list[np.ndarray]:
    """Centres of the three largest clusters, and of all points."""
    thin = cloud.thinned(1500)
    large = [thin.points[mine].mean(axis=0) for mine in portions.clusters(thin.points, REACH_M, len(thin) // 10)[:3]]
    return large if len(large) == 1 else [cloud.points.mean(axis=0), *large]


def doubt(part: Sight, stayed: Sight, target: Target, screw: Screw) -> str:
    """Reason for rejecting the joint of a part; empty if it is accepted.

    Args:
        part: Points of the moved part.
        stayed: Points of the fixed part, in the same frame.
        target: The second sight.
        screw: The joint, in the same frame.
    """
    motion, eye = screw.motion(), target.sight.eye
    moved = part.inner.moved(motion)
    if screw.type == "revolute" and screw.amount < LEAST_TURN:
        return f"it turned by {np.degrees(screw.amount):.1f} deg, which a slide would look like"
    if len(stayed.inner) and not Plausible(part.inner, stayed.inner).possible(motion):
        return "its axis is not where both parts are"
    if screw.residual > LARGEST_RESIDUAL * max(part.sigma, target.sight.sigma):
        return f"the moved part is {1000.0 * screw.residual:.1f} mm off the second capture"
    if eye is not None and eye.empty(moved.points) > LARGEST_EMPTY:
        return f"{100.0 * eye.empty(moved.points):.0f} % of it would be where the second capture shows nothing"
    shown = np.ones(len(moved), bool) if eye is None else ~eye.hides(moved.points)
    there = target.explained(moved, 3.0 * part.sigma)[shown]
    if not len(there) or there.mean() < LEAST_SURE:
        return "too little of it is seen in both captures"
    return ""
