"""Parts of an object that was seen in two states: what stayed, and what moved relative to it.

The largest surface that a motion on the support lays on the second sight is the part that stayed. What remains is laid
on what remains there, part by part, and each motion is read as a turn about a line or a slide.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dextera_build.geometry import registration, transforms

from .clouds import Cloud, Sight
from .matching import FREE, PLANAR, Target, beside, best, laid, narrow, standing
from .plausible import Plausible
from .screw import Screw, fit

LEAST_SHARE = 0.02
"""Least part of the seen points that a moved part has."""
LEAST_EXPLAINED = 0.2
"""Least part of a moved part's points, of those that the second sight would show, that it does show."""
LEAST_POINTS = 60
"""Least number of points of a moved part."""
TURNS_DEG = (12, 25, 40, 60, 80, 105, 130)
"""Turns that a search starts with, both ways."""


@dataclass(frozen=True)
class States:
    """An object in two states."""

    labels: np.ndarray  # (N,) part of each seen point: 0 stayed, 1.. moved
    screws: tuple[Screw, ...]  # of parts 1.., in the frame of the first sight; `amount` leads to the second state
    stayed: np.ndarray  # (4, 4) motion of part 0 from the first world to the second


def find(first: Sight, second: Sight) -> States | None:
    """Find the parts of `first`, an object, that moved until `second` was seen.

    Args:
        first: The object in the first state.
        second: The second state in its own world: the object, or everything on the support.

    Returns:
        The parts; None if nothing moved.
    """
    target = Target(second)
    stayed = standing(first, target)
    here = first.moved(stayed)
    motions = [np.eye(4)]
    for _ in range(4):
        labels = _labels(here, target, motions)
        found = _moved(here, labels, motions, _Open.of(first, second, stayed))
        if found is None:
            break
        motions.append(found)
        stayed, motions = _again(first, here, target, motions, stayed)
        here = first.moved(stayed)
    if len(motions) == 1:
        return None
    labels = _filled(here, _labels(here, target, motions))
    screws = []
    for number, motion in enumerate(motions[1:], start=1):
        screw = fit(_part(here, labels, number), target, motion, stayed[:3, 2])
        if screw is None:
            return None
        screws.append(_carried(screw, transforms.invert(stayed)))
    return States(labels, tuple(screws), stayed)


@dataclass(frozen=True)
class _Open:
    """What would be seen in the other state, too, if it had stayed."""

    second: Sight
    first_points: np.ndarray  # (N,) bool
    second_points: np.ndarray  # (M,) bool

    @classmethod
    def of(cls, first: Sight, second: Sight, stayed: np.ndarray) -> _Open:
        mine, theirs = np.ones(len(first.inner), bool), np.ones(len(second.inner), bool)
        if second.eye is not None:
            mine = ~second.eye.hides(transforms.apply(stayed, first.inner.points))
        if first.eye is not None:
            theirs = ~first.eye.hides(transforms.apply(transforms.invert(stayed), second.inner.points))
        return cls(second, mine, theirs)


def _moved(here: Sight, labels: np.ndarray, motions: list[np.ndarray], sights: _Open) -> np.ndarray | None:
    """The motion of the largest part that no motion so far explains, or None."""
    least = max(LEAST_POINTS, int(LEAST_SHARE * len(here.inner)))
    second = sights.second
    rest = _settled(here.inner, (labels < 0) & sights.first_points)
    known = np.zeros(len(second.inner), bool)
    for number, motion in enumerate(motions):
        mine = _part(here, labels, number).moved(motion)
        if len(mine.inner):
            laid_on = Target(mine)
            known |= laid_on.explained(second.inner, 3.0 * second.sigma)
    left = _settled(second.inner, ~known & sights.second_points)
    if rest.sum() < least or left.sum() < least:
        return None
    source = _with_borders(here, rest)
    target = Target(_with_borders(second, _near(second.inner, left)))
    around = _part(here, labels, 0).inner if (labels == 0).any() else here.inner
    starts = _starts(source.inner, target.sight.inner, here.inner)
    plausible = Plausible(source.inner, around)
    motion = best(starts, source, target, FREE, 12, plausible)
    moved = source.inner.moved(motion)
    explained = target.explained(moved, 3.0 * source.sigma)
    shown = np.ones(len(moved), bool) if second.eye is None else ~second.eye.hides(moved.points)
    covered = Target(source.moved(motion)).explained(second.inner.some(left), 3.0 * source.sigma)
    enough = (
        explained.sum() >= least
        and explained[shown].mean() >= LEAST_EXPLAINED
        # An edge that is laid somewhere on a face says nothing of the face's motion; other parts may have moved, too.
        and covered.mean() >= 0.7 * LEAST_EXPLAINED
    )
    return motion if enough and plausible.possible(motion) else None


def _starts(source: Cloud, target: Cloud, whole: Cloud) -> list[np.ndarray]:
    """Turns about the vertical and two level directions, and shifts, between the clusters of both clouds."""
    level = whole.normals[np.abs(whole.normals[:, 2]) < 0.3][:, :2]
    if len(level) > 30:
        double = np.exp(4j * np.angle(level[:, 0] + 1j * level[:, 1])).sum()
        heading = float(np.angle(double)) / 4.0
    else:
        flat = whole.points[:, :2] - whole.points[:, :2].mean(axis=0)
        heading = float(np.arctan2(*np.linalg.svd(flat, full_matrices=False)[2][0][::-1]))
    along = np.array([np.cos(heading), np.sin(heading), 0.0])
    axes = [np.array([0.0, 0.0, 1.0]), along, np.array([-along[1], along[0], 0.0])]
    turns = [np.eye(3)]
    turns += [registration.rotation(axis * s * np.radians(a)) for axis in axes for a in TURNS_DEG for s in (1, -1)]
    return [
        transforms.rigid(turn, there - turn @ here)
        for here in _middles(source)
        for there in _middles(target)
        for turn in turns
    ]


def _middles(cloud: Cloud, reach: float = 0.012) -> list[np.ndarray]:
    """Middles of the three largest clusters, and of all."""
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    points = cloud.thinned(1500).points
    graph = KDTree(points).sparse_distance_matrix(KDTree(points), reach)
    _, label = connected_components(graph, directed=False)
    sizes = np.bincount(label)
    large = [k for k in np.argsort(-sizes)[:3] if sizes[k] > 0.1 * len(points)]
    middles = [points[label == k].mean(axis=0) for k in large]
    return middles if len(middles) == 1 else [points.mean(axis=0), *middles]


def _labels(here: Sight, target: Target, motions: list[np.ndarray]) -> np.ndarray:
    """(N,) number of the first motion that lays a point on the target; -1 for none."""
    labels = np.full(len(here.inner), -1)
    for number, motion in reversed(list(enumerate(motions))):
        labels[target.explained(here.inner.moved(motion), 2.5 * here.sigma)] = number
    return labels


def _again(
    first: Sight, here: Sight, target: Target, motions: list[np.ndarray], stayed: np.ndarray
) -> tuple[np.ndarray, list[np.ndarray]]:
    """All motions once more, each from the points of its own part alone."""
    labels = _filled(here, _labels(here, target, motions))
    gates = narrow(first.sigma)
    own = [_part(here, labels, number) for number in range(len(motions))]
    moved = [
        laid(motion, part, target, gates, FREE) if len(part.inner) > LEAST_POINTS else motion
        for motion, part in zip(motions, own, strict=True)
    ]
    if len(own[0].inner) > LEAST_POINTS:
        # The borders of parts that moved may have held the whole object aside.
        moved[0] = best([moved[0], *beside(own[0])], own[0], target, PLANAR)
    back = transforms.invert(moved[0])
    return moved[0] @ stayed, [np.eye(4), *(motion @ back for motion in moved[1:])]


def _filled(here: Sight, labels: np.ndarray) -> np.ndarray:
    """Points that no motion explains take the part of most of their neighbours."""
    from scipy.spatial import KDTree

    known = np.flatnonzero(labels >= 0)
    if not len(known):
        return np.zeros(len(labels), int)
    nearest = KDTree(here.inner.points[known]).query(here.inner.points, k=min(15, len(known)))[1]
    votes = labels[known][nearest].reshape(len(labels), -1)
    count = np.stack([(votes == number).sum(axis=1) for number in range(labels.max() + 1)])
    return np.asarray(count.argmax(axis=0))


def _settled(cloud: Cloud, mask: np.ndarray, count: int = 12) -> np.ndarray:
    """The points of a mask most of whose neighbours are in it, too."""
    from scipy.spatial import KDTree

    if not mask.any():
        return mask
    nearest = KDTree(cloud.points).query(cloud.points, k=min(count, len(cloud)))[1]
    return np.asarray(mask & (mask[nearest].reshape(len(mask), -1).mean(axis=1) > 0.6))


def _near(cloud: Cloud, chosen: np.ndarray, reach: float = 0.01) -> np.ndarray:
    """Points within `reach` [m] of chosen ones: where a part moved along itself, most of it looks unmoved."""
    from scipy.spatial import KDTree

    return np.asarray(np.isfinite(KDTree(cloud.points[chosen]).query(cloud.points, distance_upper_bound=reach)[0]))


def _part(here: Sight, labels: np.ndarray, number: int) -> Sight:
    return _with_borders(here, labels == number)


def _with_borders(sight: Sight, chosen: np.ndarray) -> Sight:
    """Chosen points and the borders whose nearest point is one of them."""
    from scipy.spatial import KDTree

    if not len(sight.border):
        return sight.some(chosen, np.zeros(0, bool))
    nearest = KDTree(sight.inner.points).query(sight.border.points)[1]
    return sight.some(chosen, chosen[nearest])


def _carried(screw: Screw, motion: np.ndarray) -> Screw:
    return replace(screw, origin=transforms.apply(motion, screw.origin), axis=motion[:3, :3] @ screw.axis)
