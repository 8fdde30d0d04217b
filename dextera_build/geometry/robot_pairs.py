"""Point pairs of balanced ICP: sampling of the model's surface, and matching."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dextera_build.geometry import transforms


@dataclass(frozen=True)
class Surface:
    """Points of one component (arm or hand) in one pose of the robot, in the camera frame."""

    model: np.ndarray  # (N, 3) visible points of the model, at the first calibration [m]
    normals: np.ndarray  # (N, 3) of the model, unit
    link: np.ndarray  # (N,) int, number of the link of each point; errors within a link are correlated
    seen: np.ndarray  # (M, 3) measured points on this component [m]
    drift: np.ndarray | None = None  # (N, 3, Q) motion of the points per motion of each joint [m/rad]


@dataclass(frozen=True)
class Pairs:
    """All components and poses, one row per model point."""

    model: np.ndarray
    normals: np.ndarray
    link: np.ndarray
    pose: np.ndarray
    part: np.ndarray
    drift: np.ndarray


def drawn(
    poses: Sequence[Mapping[str, Surface]], names: list[str], points: int, balanced: bool, draw: np.random.Generator
) -> Pairs:
    """Random points of the model's surfaces: a fixed number per component over all poses, or of both without balance.

    Raises:
        ValueError: A component has fewer than 20 points, or no component is visible.
    """
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
            rows.append(Pairs(surface.model[chosen], normals, link, number * ones, part, drift[chosen]))
    if not rows:
        raise ValueError("nothing was seen")
    return Pairs(*(np.concatenate([getattr(row, field) for row in rows]) for field in Pairs.__dataclass_fields__))


@dataclass(frozen=True)
class Matcher:
    """Nearest neighbours on one component in one pose."""

    surface: Surface
    seen: Any
    model: Any

    def target(self, motion: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Seen points (N, 3) nearest to moved points, and the model's normals (N, 3) there, in the model's frame."""
        near = self.surface.seen[self.seen.query(transforms.apply(motion, points))[1]]
        back = self.model.query(transforms.apply(transforms.invert(motion), near))[1]
        return near, self.surface.normals[back]


@dataclass(frozen=True)
class Matched:
    """Sampled points of the model, and the trees in which their partners are found."""

    pairs: Pairs
    names: list[str]  # of the components, in the order of `pairs.part`
    trees: Mapping[tuple[int, int], Matcher]  # by pose and component
    groups: Mapping[tuple[int, int], np.ndarray]  # rows of `pairs` of each tree

    def near(self, motion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Seen points (N, 3) nearest to the moved model, of the same component and pose, and normals (N, 3).

        Normals are the mean of the model's normals at both ends of a pair (the symmetric objective of Rusinkiewicz
        2019), because on a curved surface the tangent plane at one end misses the point at the other: by 0.2 mm on
        fingers.
        """
        target, normals = np.full_like(self.pairs.model, np.nan), self.pairs.normals.copy()
        for key, matcher in self.trees.items():
            rows = self.groups[key]
            target[rows], there = matcher.target(motion, self.pairs.model[rows])
            both = normals[rows] + there
            normals[rows] = both / np.maximum(np.linalg.norm(both, axis=1, keepdims=True), 1e-9)
        return target, normals @ motion[:3, :3].T


def matched(poses: Sequence[Mapping[str, Surface]], points: int, balanced: bool, draw: np.random.Generator) -> Matched:
    """Sample the model's points, see `drawn`, and prepare the search for their partners.

    Raises:
        ValueError: A component has fewer than 20 points, or no component is visible.
    """
    from scipy.spatial import cKDTree

    names = sorted({name for pose in poses for name in pose})
    pairs = drawn(poses, names, points, balanced, draw)
    trees = {
        (number, names.index(name)): Matcher(surface, cKDTree(surface.seen), cKDTree(surface.model))
        for number, pose in enumerate(poses)
        for name, surface in pose.items()
        if len(surface.seen) and len(surface.model)
    }
    groups = {key: np.flatnonzero((pairs.pose == key[0]) & (pairs.part == key[1])) for key in trees}
    return Matched(pairs, names, trees, groups)
