"""Morphology-balanced ICP: one rigid correction of a robot's model in the camera frame, from all poses together.

Eq. 2 and 3 of the paper: min over dT of (loss of the arm + loss of the hand) / 2, then T_camera_base = dT
T_camera_base0. An arm has many times the points of a hand. With equal weights of all points, a small error of the arm's
model would displace the hand, whose accuracy matters for grasping.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import least_squares, lie, robot_covariance, robot_pairs, transforms
from dextera_build.geometry.robot_covariance import Doubts
from dextera_build.geometry.robot_pairs import Matched, Pairs, Surface

KEEP = 0.85
"""Fraction of the pairs of each component that remain after trimming."""
ITERATIONS = 40
STILL = 1e-6
"""Step size at which the iteration ends, in metres and radians."""


@dataclass(frozen=True)
class Corrected:
    """Result of the registration."""

    motion: np.ndarray  # (4, 4) dT, in the camera frame, applied from the left
    covariance: np.ndarray  # (6, 6) covariance of dT: translation [m], rotation vector [rad], in the camera frame
    residuals: Mapping[str, np.ndarray]  # component -> (K,) root mean square point-to-plane distance per pose [m]
    curvature: np.ndarray  # (6,) eigenvalues of the information with rotations about the centre of the points, per unit
    iterations: int


def correct(
    poses: Sequence[Mapping[str, Surface]],
    *,
    points: int = 4000,
    balanced: bool = True,
    doubts: Doubts | None = None,
    seed: int = 0,
) -> Corrected:
    """Register the model to the measured points of all poses.

    Args:
        poses: For each pose of the robot, component -> its points; a component may be missing where it is not visible.
        points: Number of points of each component over all poses, N of Eq. 2.
        balanced: False weights all points equally, as plain ICP does, for comparison.
        doubts: Joint and surface errors, for the covariance.
        seed: Seed of the sampling of points.

    Raises:
        ValueError: A component has fewer than 20 points, or no component is visible.
    """
    matched = robot_pairs.matched(poses, points, balanced, np.random.default_rng(seed))
    pairs, names = matched.pairs, matched.names
    middle = pairs.model.mean(axis=0)

    def step(motion: np.ndarray, _: int) -> tuple[np.ndarray, np.ndarray]:
        change = least_squares.normal(*linear(motion, matched, middle, balanced)).shortest(1e-10)
        return change, lie.motion(change, middle) @ motion

    *before, motion = least_squares.gauss_newton(np.eye(4), step, range(ITERATIONS), STILL)
    row, off, weight = linear(motion, matched, middle, balanced)
    information = least_squares.normal(row, off, weight).matrix
    about = robot_covariance.covariance(row, off, weight, pairs, motion, doubts or Doubts())
    return Corrected(
        motion=motion,
        covariance=robot_covariance.moved(about, transforms.apply(motion, middle[None])[0], motion),
        residuals=_residuals(off, weight, pairs, names, len(poses)),
        curvature=np.linalg.eigvalsh(information),
        iterations=len(before),
    )


def linear(
    motion: np.ndarray, matched: Matched, middle: np.ndarray, balanced: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs at dT `motion` (4, 4), trimmed: rows (N, 6), distances (N,) along the model's normals, and weights (N,).

    The weights sum to 1, in equal parts for each component if `balanced`. Rows are the derivatives by a twist about
    the moved `middle` (3,).
    """
    pairs, parts = matched.pairs, len(matched.names)
    placed, (target, normals) = transforms.apply(motion, pairs.model), matched.near(motion)
    arms = placed - transforms.apply(motion, middle[None])[0]
    offset = target - placed
    row = lie.point_to_plane_rows(arms, normals)[:, :6]
    off = (normals * offset).sum(axis=1)
    distance = np.linalg.norm(offset, axis=1)
    weight = np.zeros(len(placed))
    # A component with all points matched is still trimmed, so that components have equal total weights.
    for part in range(parts) if balanced else [None]:
        own = np.ones(len(placed), bool) if part is None else pairs.part == part
        own &= np.isfinite(distance)
        if own.any():
            kept = own & (distance <= np.quantile(distance[own], KEEP))
            weight[kept] = 1.0 / (kept.sum() * (parts if balanced else 1))
    return row, np.where(weight > 0, off, 0.0), weight


def _residuals(
    off: np.ndarray, weight: np.ndarray, pairs: Pairs, names: list[str], count: int
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
