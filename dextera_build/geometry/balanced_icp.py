"""Morphology-balanced ICP: one rigid correction of a robot's model in the camera frame, from all poses together.

Eq. 2 and 3 of the paper: min over dT of (loss of the arm + loss of the hand) / 2, then
T_camera_base = dT T_camera_base0. An arm gives many times the points of a hand. Weighing points alike would let a small
error of the arm's model push the hand, which has to grasp, off its place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dextera_build.geometry import registration, transforms

KEEP = 0.85
"""Pairs that remain after trimming, of each component."""
ITERATIONS = 40
INDEPENDENT = 40.0
"""Measurements that the points of a link in one pose count as, however many they are."""
STILL = 1e-6
"""Last step, in metres and radians."""


@dataclass(frozen=True)
class Surface:
    """Points of one component (arm or hand) in one pose of the robot, in the camera frame."""

    model: np.ndarray  # (N, 3) visible points of the model, at the first calibration [m]
    normals: np.ndarray  # (N, 3) of the model, unit
    link: np.ndarray  # (N,) int, number of the link that each belongs to; links err together
    seen: np.ndarray  # (M, 3) points that the camera measured on this component [m]
    drift: np.ndarray | None = None  # (N, 3, Q) motion of the points per motion of each joint [m/rad]


@dataclass(frozen=True)
class Doubts:
    """What is known of the joints' errors, as standard deviations [rad]."""

    joint_rad: float = 0.0
    """Of each joint's zero, the same in all poses."""
    encoder_rad: float = 0.0
    """Of each reading."""
    surface_m: float = 0.0003
    """Of a link's surface from its model's, along its normals; matching itself leaves 0.2 mm on round fingers."""


@dataclass(frozen=True)
class Corrected:
    """What the registration found."""

    motion: np.ndarray  # (4, 4) dT, in the camera frame, applied from the left
    covariance: np.ndarray  # (6, 6) of dT: translation [m], rotation vector [rad], in the camera frame
    residuals: Mapping[str, np.ndarray]  # component -> (K,) root mean square point-to-plane distance per pose [m]
    curvature: np.ndarray  # (6,) eigenvalues of the information with rotations about the points' middle, per unit
    iterations: int


@dataclass(frozen=True)
class _Pairs:
    """All components and poses, one row per model point."""

    model: np.ndarray
    normals: np.ndarray
    link: np.ndarray
    pose: np.ndarray
    part: np.ndarray
    drift: np.ndarray


def correct(
    poses: Sequence[Mapping[str, Surface]],
    *,
    points: int = 4000,
    balanced: bool = True,
    doubts: Doubts | None = None,
    seed: int = 0,
) -> Corrected:
    """Find the correction.

    Args:
        poses: For each pose of the robot, component -> its points; a component may be missing where it is not seen.
        points: Of each component over all poses, N of Eq. 2.
        balanced: False weighs all points alike, as plain ICP does, for comparison.
        doubts: Of the joints, for the covariance.
        seed: Of the draw of points.

    Raises:
        ValueError: There are fewer than 20 points of a component, or nothing was seen.
    """
    from scipy.spatial import cKDTree

    names = sorted({name for pose in poses for name in pose})
    pairs = _drawn(poses, names, points, balanced, np.random.default_rng(seed))
    trees = {
        (number, names.index(name)): _Matcher(surface, cKDTree(surface.seen), cKDTree(surface.model))
        for number, pose in enumerate(poses)
        for name, surface in pose.items()
        if len(surface.seen) and len(surface.model)
    }
    groups = {key: np.flatnonzero((pairs.pose == key[0]) & (pairs.part == key[1])) for key in trees}
    middle = pairs.model.mean(axis=0)
    motion, rounds = np.eye(4), 0
    while rounds < ITERATIONS:
        rounds += 1
        row, off, weight = _linear(motion, pairs, _nearest(motion, pairs, trees, groups), middle, len(names), balanced)
        step = np.linalg.lstsq(row.T @ (row * weight[:, None]), row.T @ (weight * off), rcond=1e-10)[0]
        motion = _stepped(step, middle) @ motion
        if np.abs(step).max() < STILL:
            break
    row, off, weight = _linear(motion, pairs, _nearest(motion, pairs, trees, groups), middle, len(names), balanced)
    information = row.T @ (row * weight[:, None])
    about = _covariance(row, off, weight, pairs, motion, doubts or Doubts())
    return Corrected(
        motion=motion,
        covariance=_moved_covariance(about, transforms.apply(motion, middle[None])[0], motion),
        residuals=_residuals(off, weight, pairs, names, len(poses)),
        curvature=np.linalg.eigvalsh(information),
        iterations=rounds,
    )


def _drawn(
    poses: Sequence[Mapping[str, Surface]], names: list[str], points: int, balanced: bool, draw: np.random.Generator
) -> _Pairs:
    rows = []
    totals = {name: sum(len(pose[name].model) for pose in poses if name in pose) for name in names}
    if not totals or min(totals.values()) < 20:
        raise ValueError(f"too few points: {totals}")
    share = {name: min(1.0, points / totals[name]) for name in names}
    if not balanced:
        share = dict.fromkeys(names, min(1.0, points * len(names) / sum(totals.values())))
    for number, pose in enumerate(poses):
        for name, surface in pose.items():
            if not len(surface.seen):
                continue
            count = len(surface.model)
            chosen = draw.permutation(count)[: max(1, round(share[name] * count))] if count else np.zeros(0, int)
            ones = np.ones(len(chosen), int)
            normals, link = surface.normals[chosen], surface.link[chosen]
            drift = np.zeros((count, 3, 0)) if surface.drift is None else surface.drift
            part = names.index(name) * ones
            rows.append(_Pairs(surface.model[chosen], normals, link, number * ones, part, drift[chosen]))
    if not rows:
        raise ValueError("nothing was seen")
    return _Pairs(*(np.concatenate([getattr(row, field) for row in rows]) for field in _Pairs.__dataclass_fields__))


@dataclass(frozen=True)
class _Matcher:
    """Nearest neighbours on one component in one pose."""

    surface: Surface
    seen: Any
    model: Any

    def target(self, motion: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Seen points (N, 3) nearest to moved points, and the model's normals (N, 3) there, in the model's frame."""
        near = self.surface.seen[self.seen.query(transforms.apply(motion, points))[1]]
        back = self.model.query(transforms.apply(transforms.invert(motion), near))[1]
        return near, self.surface.normals[back]


def _nearest(
    motion: np.ndarray, pairs: _Pairs, trees: Mapping[tuple[int, int], _Matcher], groups: Mapping[tuple[int, int], Any]
) -> tuple[np.ndarray, np.ndarray]:
    """Seen points (N, 3) nearest to the moved model, of the same component and pose, and normals (N, 3) of the pairs.

    The mean of the model's normals at both ends of a pair, because between the tangent at one end and the next point
    of a round surface there is a gap (the symmetric objective of Rusinkiewicz 2019): on fingers it was 0.2 mm.
    """
    target, normals = np.full_like(pairs.model, np.nan), pairs.normals.copy()
    for key, matcher in trees.items():
        rows = groups[key]
        target[rows], there = matcher.target(motion, pairs.model[rows])
        both = normals[rows] + there
        normals[rows] = both / np.maximum(np.linalg.norm(both, axis=1, keepdims=True), 1e-9)
    return target, normals @ motion[:3, :3].T


def _linear(
    motion: np.ndarray,
    pairs: _Pairs,
    near: tuple[np.ndarray, np.ndarray],
    middle: np.ndarray,
    parts: int,
    balanced: bool,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows (N, 6), distances (N,) along the model's normals, and weights (N,) that sum to 1."""
    placed, (target, normals) = transforms.apply(motion, pairs.model), near
    arms = placed - transforms.apply(motion, middle[None])[0]
    offset = target - placed
    row = np.hstack([normals, np.cross(arms, normals)])
    off = (normals * offset).sum(axis=1)
    distance = np.linalg.norm(offset, axis=1)
    weight = np.zeros(len(placed))
    # A component whose every point is matched still has its worst pairs left out, and then counts as much as the other.
    for part in range(parts) if balanced else [None]:
        own = np.ones(len(placed), bool) if part is None else pairs.part == part
        own &= np.isfinite(distance)
        if own.any():
            kept = own & (distance <= np.quantile(distance[own], KEEP))
            weight[kept] = 1.0 / (kept.sum() * (parts if balanced else 1))
    return row, np.where(weight > 0, off, 0.0), weight


def _stepped(step: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """(4, 4) of a step (6,): translation, and rotation about a point."""
    turn = registration.rotation(step[3:])
    return transforms.rigid(turn, step[:3] + middle - turn @ middle)


def _covariance(
    row: np.ndarray, off: np.ndarray, weight: np.ndarray, pairs: _Pairs, motion: np.ndarray, doubts: Doubts
) -> np.ndarray:
    """(6, 6) about the points' middle: of what the residuals show, and of joints, whose errors they do not show.

    An error of the first joint's zero is a rotation of the base, so no residual tells it; it is taken as stated.
    """
    inverse = np.linalg.pinv(row.T @ (row * weight[:, None]), rcond=1e-12)
    total = np.zeros((6, 6))
    # Neighbouring pixels err together, so thousands of points of a link in a pose count as few measurements.
    _, cluster, count = np.unique(
        (pairs.part * 1000 + pairs.link) * 10000 + pairs.pose, return_inverse=True, return_counts=True
    )
    for part in np.unique(pairs.part):
        own = (pairs.part == part) & (weight > 0)
        variance = float((off[own] ** 2).mean()) if own.any() else 0.0
        alike = np.maximum(1.0, count[cluster[own]] / INDEPENDENT)
        total += variance * row[own].T @ (row[own] * (weight[own] ** 2 * alike)[:, None])
    along = np.einsum("ni,ij,njq->nq", row[:, :3], motion[:3, :3], pairs.drift) * weight[:, None]
    for number in np.unique(pairs.pose):
        own = pairs.pose == number
        by = doubts.encoder_rad * row[own].T @ along[own]
        total += by @ by.T
    for part in np.unique(pairs.part):
        total += _of_surfaces(row, off, weight, pairs, part, doubts.surface_m)
    by = doubts.joint_rad * row.T @ along
    return np.asarray(inverse @ (total + by @ by.T) @ inverse)


def _of_surfaces(
    row: np.ndarray, off: np.ndarray, weight: np.ndarray, pairs: _Pairs, part: int, stated: float
) -> np.ndarray:
    """(6, 6): links of a component may be larger or smaller than their model, as their mean residuals show."""
    groups = [
        np.flatnonzero((pairs.part == part) & (pairs.link == link) & (weight > 0)) for link in np.unique(pairs.link)
    ]
    groups = [own for own in groups if len(own)]
    if not groups:
        return np.zeros((6, 6))
    # The fit takes a part of the offsets away, as that of any six parameters does.
    left = max(len(groups) - 3, 1) / len(groups)
    shown = np.average([off[own].mean() ** 2 for own in groups], weights=[weight[own].sum() for own in groups]) / left
    each = np.array([(row[own] * weight[own, None]).sum(axis=0) for own in groups])
    # All links of a component may err alike, too: by covers over all of them, or by the depth camera's own bias.
    return np.asarray(max(stated**2, float(shown)) * (each.T @ each + np.outer(each.sum(axis=0), each.sum(axis=0))))


def _moved_covariance(about: np.ndarray, middle: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Covariance of dT from that of a translation and a rotation about the points' middle."""
    # dT = Exp(dr) about `middle`, so its translation also moves by dr x (t - middle).
    by = np.eye(6)
    by[:3, 3:] = -transforms.cross_matrix(motion[:3, 3] - middle)
    return np.asarray(by @ about @ by.T)


def _residuals(
    off: np.ndarray, weight: np.ndarray, pairs: _Pairs, names: list[str], count: int
) -> dict[str, np.ndarray]:
    found = {}
    for number, name in enumerate(names):
        each = np.full(count, np.nan)
        for pose in range(count):
            own = (pairs.part == number) & (pairs.pose == pose) & (weight > 0)
            if own.any():
                each[pose] = np.sqrt((off[own] ** 2).mean())
        found[name] = each
    return found
