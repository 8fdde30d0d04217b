"""A depth picture registered to other depth pictures of the same scene, from a nearby pose.

Points of the picture are compared with the surfaces that the others show at the same place (projective point-to-plane
ICP, Blais and Levine 1995), and with the points that features match. Surfaces alone leave a plane free to slide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.geometry import cameras, least_squares, lie, normals, planes, transforms

POINTS = 6000
"""Number of points of the picture that are compared."""
GATES_M = (0.05, 0.03, 0.02, 0.015, 0.015, 0.01, 0.01, 0.01)
"""Distance above which two surfaces are not the same one, in each round [m]."""
FEATURE_PX = 1.5
"""Standard deviation of a matched point [px]."""
INDEPENDENT = 60.0
"""Effective number of independent pairs of surfaces; errors of neighbours are correlated."""
FACING = 0.3
"""Cosine between the normals of two pictures' surfaces, and between normal and line of sight, below which they are no
pair."""
NEAR_M = 0.02
"""Distance at which two surfaces agree [m]."""
WIDE = 0.08
"""Least fraction of the points on a plane that is a table, a floor or a wall."""
FEWEST = 50
"""Fewer points on no such plane tell nothing."""


@dataclass(frozen=True)
class Depths:
    """A depth picture with its pose."""

    capture: Capture
    depth: np.ndarray  # (H, W) float64 [m]; 0 where nothing was measured
    pose: np.ndarray  # (4, 4) T_first_camera
    normals: np.ndarray  # (H, W, 3) camera frame, 0 where unknown

    @classmethod
    def of(cls, capture: Capture, pose: np.ndarray) -> Depths:
        """With the normals of its surfaces."""
        assert capture.measured is not None
        depth = capture.measured.depth.depth.astype(np.float64)
        inverse = np.where(depth > 0, 1.0 / np.maximum(depth, 1e-9), 0.0)
        tolerance = planes.depth_sigma(depth) * np.square(inverse)
        return cls(capture, depth, pose, normals.fit(inverse, tolerance).normals(capture.photograph.camera.matrix()))

    @property
    def k(self) -> np.ndarray:
        """(3, 3) intrinsics [px]."""
        return self.capture.photograph.camera.matrix()


@dataclass(frozen=True)
class Agreement:
    """How well a picture agrees with the others."""

    overlap: float
    """Fraction of its points whose place another picture shows, at a depth that does not hide it."""
    same: float
    """Fraction of these whose surface is within `NEAR_M`."""
    residual_m: float
    """Median distance of the latter from the surface [m]."""
    things: float
    """As `same`, of points on no large plane, which also tell a motion along table and walls; 1 without such points."""


def refined(own: Depths, others: Sequence[Depths], here: np.ndarray, there: np.ndarray) -> np.ndarray:
    """T_first_camera (4, 4) of `own` that agrees best with the others and with matched points.

    Args:
        own: The picture, with the initial pose.
        others: Pictures with their poses, at least one.
        here: (M, 3) matched points in its own camera frame [m].
        there: (M, 3) the same points in the frame of the first camera [m].
    """
    points, facing = _sample(own)
    middle = points.mean(axis=0)
    spread = np.linalg.norm(here, axis=1) * FEATURE_PX / own.k[0, 0] + planes.depth_sigma(here[:, 2])

    def step(pose: np.ndarray, gate: float) -> tuple[np.ndarray, np.ndarray]:
        pivot = transforms.apply(pose, middle[None])[0]
        total = least_squares.prior(np.array([0.05, 0.05, 0.05, 0.05, 0.05, 0.05]))
        moved = transforms.apply(pose, here)
        apart = there - moved
        trust = least_squares.huber(np.linalg.norm(apart, axis=1), 2.0 * spread) / np.square(spread)
        rows = lie.point_motions(moved - pivot)[:, :, :6].reshape(-1, 6)
        total += least_squares.normal(rows, apart.reshape(-1), np.repeat(trust, 3))
        placed = transforms.apply(pose, points)
        for other in others:
            target, normal, near = _met(other, placed, facing @ pose[:3, :3].T, gate)
            if near.sum() < 50:
                continue
            offset = ((target - placed[near]) * normal).sum(axis=1)
            sigma = planes.depth_sigma(points[near, 2])
            weight = least_squares.huber(np.abs(offset), 2.0 * sigma) / np.square(sigma)
            weight *= min(1.0, INDEPENDENT / near.sum())
            rows = lie.point_to_plane_rows(placed[near] - pivot, normal)[:, :6]
            total += least_squares.normal(rows, offset, weight)
        change = total.solved()
        return change, lie.motion(change, pivot) @ pose

    *_, found = least_squares.gauss_newton(own.pose, step, GATES_M, 1e-6)
    return found


def agreement(own: Depths, others: Sequence[Depths]) -> Agreement:
    """How well `own` agrees with the others at its pose."""
    points, _ = _sample(own)
    placed = transforms.apply(own.pose, points)
    met, apart = np.zeros(len(placed), bool), np.full(len(placed), np.inf)
    for other in others:
        local = transforms.apply(transforms.invert(other.pose), placed)
        row, column, inside = cameras.nearest_pixels(local, other.k, other.depth.shape)
        shown = other.depth[row, column]
        here = inside & (shown > 0) & (local[:, 2] < shown + NEAR_M)
        met |= here
        apart = np.where(here, np.minimum(apart, np.abs(local[:, 2] - shown)), apart)
    same = met & (apart < NEAR_M)
    residual = float(np.median(apart[same])) if same.any() else float("inf")
    loose = met & _loose(points)
    things = float(same[loose].mean()) if loose.sum() >= FEWEST else 1.0
    return Agreement(float(met.mean()), float(same.sum() / max(1, met.sum())), residual, things)


def _loose(points: np.ndarray) -> np.ndarray:
    """Which of the points (N, 3) are on no large plane."""
    left, rng = np.arange(len(points)), np.random.default_rng(0)
    least = max(3, int(WIDE * len(points)))
    while found := planes.largest(points[left], planes.depth_sigma(points[left, 2]), rng, least=least):
        left = left[~found[1]]
    return np.isin(np.arange(len(points)), left)


def _sample(own: Depths) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) with known normals, and these (N, 3), in the camera frame."""
    known = (own.depth > 0) & (np.abs(own.normals).sum(axis=-1) > 0)
    points, facing = cameras.backproject(own.depth, own.k)[known], own.normals[known]
    every = max(1, len(points) // POINTS)
    return points[::every], facing[::every]


def _met(
    other: Depths, placed: np.ndarray, facing: np.ndarray, gate: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (K, 3) and normals (K, 3) of a picture's surfaces at the places of points (N, 3), and for which (N,)."""
    local = transforms.apply(transforms.invert(other.pose), placed)
    row, column, inside = cameras.nearest_pixels(local, other.k, other.depth.shape)
    shown, normal = other.depth[row, column], other.normals[row, column] @ other.pose[:3, :3].T
    ray = local / np.maximum(np.linalg.norm(local, axis=1, keepdims=True), 1e-9) @ other.pose[:3, :3].T
    near = inside & (shown > 0) & ((normal * facing).sum(axis=1) > FACING) & (-(normal * ray).sum(axis=1) > FACING)
    target = transforms.apply(other.pose, local * (shown / np.maximum(local[:, 2], 1e-9))[:, None])
    near &= np.abs(((target - placed) * normal).sum(axis=1)) < gate
    return target[near], normal[near], near
