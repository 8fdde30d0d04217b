"""Registration of a robot's surface with the robot's own errors as further unknowns.

Balanced ICP (`balanced_icp`) takes the model as exact: an arm whose covers are a millimetre thicker pushes the camera
away by as much. Here every link has an unknown offset of its surface along the normals, every joint an unknown zero,
and every reading of a joint an unknown error, each with a standard deviation; the pose is estimated together with them.
Arm and hand have the same number of points, as in Eq. 2 of the paper.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import least_squares, lie, robot_covariance, robot_pairs, transforms
from dextera_build.geometry.balanced_icp import linear
from dextera_build.geometry.least_squares import Normal
from dextera_build.geometry.robot_covariance import INDEPENDENT, Doubts
from dextera_build.geometry.robot_pairs import Pairs, Surface

ROUNDS = 3
"""Steps of the registration, each with new pairs."""
COMMON = 2.0
"""Standard deviation of the offset that all links of a component share, in units of that of one link: covers over all
of them, or the bias of a depth camera."""
LEAST_M = 1e-4
"""Standard deviations of surfaces and points below this are not believed [m]."""


@dataclass(frozen=True)
class Registered:
    """Result of the registration."""

    motion: np.ndarray  # (4, 4) dT, in the camera frame, applied from the left
    covariance: np.ndarray  # (6, 6) covariance of dT: translation [m], rotation vector [rad], in the camera frame
    offsets: Mapping[str, float]  # component -> mean distance of its surface outside its model [m]
    spread: np.ndarray  # (6, 6) W: e.T @ W @ e is the mean squared motion of the points by a twist e of dT [m2]


def register(
    poses: Sequence[Mapping[str, Surface]], start: np.ndarray, *, points: int = 4000, doubts: Doubts, seed: int = 0
) -> Registered:
    """Register the model to the measured points of all poses, from a motion `start` (4, 4) near the optimum.

    Args:
        poses: As of `balanced_icp.correct`.
        start: dT of a first registration.
        points: Number of points of each component over all poses.
        doubts: Standard deviations of the robot's errors; `surface_m` is that of a link's offset.
        seed: Seed of the sampling of points.

    Raises:
        ValueError: A component has fewer than 20 points, or no component is visible.
    """
    matched = robot_pairs.matched(poses, points, True, np.random.default_rng(seed))
    pairs, motion = matched.pairs, start
    middle = pairs.model.mean(axis=0)
    for _ in range(ROUNDS):
        row, off, weight = linear(motion, matched, middle, balanced=True)
        kept = weight > 0
        known = _kept(pairs, kept)
        variance = _variances(off[kept], known)
        columns, sigma = _columns(row[kept], known, motion, doubts)
        normal = least_squares.normal(columns, off[kept], 1.0 / variance) + _prior(sigma)
        found = normal.solved()
        motion = lie.motion(found[:6], middle) @ motion
    inverse = np.linalg.inv(normal.matrix)[:6]
    gain = inverse @ (columns / variance[:, None]).T
    about = inverse[:, :6] + _of_shapes(gain, off[kept] - columns @ found, known, matched.near(motion)[1][kept])
    placed = transforms.apply(motion, pairs.model)
    return Registered(
        motion=motion,
        covariance=robot_covariance.moved(about, transforms.apply(motion, middle[None])[0], motion),
        offsets=_offsets(columns, found, known, matched.names),
        spread=_spread(placed - motion[:3, 3], pairs.part),
    )


def _kept(pairs: Pairs, kept: np.ndarray) -> Pairs:
    return Pairs(*(getattr(pairs, field)[kept] for field in Pairs.__dataclass_fields__))


def _variances(off: np.ndarray, pairs: Pairs) -> np.ndarray:
    """Variance (N,) of each distance; neighbours are correlated, see `robot_covariance.INDEPENDENT` [m2]."""
    _, cluster, count = np.unique(robot_covariance.views(pairs), return_inverse=True, return_counts=True)
    own = np.zeros(len(off))
    for part in np.unique(pairs.part):
        rows = pairs.part == part
        own[rows] = max(float((off[rows] ** 2).mean()), LEAST_M**2)
    return np.asarray(own * np.maximum(1.0, count[cluster] / INDEPENDENT))


def _columns(row: np.ndarray, pairs: Pairs, motion: np.ndarray, doubts: Doubts) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (N, K) of the distances by the twist and by all errors, and standard deviations (K,), inf if free."""
    surface = max(doubts.surface_m, LEAST_M)
    blocks, sigmas = [row], [np.full(6, np.inf)]
    for part in np.unique(pairs.part):
        own = pairs.part == part
        links = [own & (pairs.link == link) for link in np.unique(pairs.link[own])]
        blocks.append(np.stack([own, *links], axis=1).astype(float))
        sigmas.append(np.array([COMMON * surface] + [surface] * len(links)))
    along = np.einsum("ni,ij,njq->nq", row[:, :3], motion[:3, :3], pairs.drift)
    joints = along.shape[1]
    if doubts.joint_rad > 0:
        blocks.append(along)
        sigmas.append(np.full(joints, doubts.joint_rad))
    if doubts.encoder_rad > 0:
        for pose in np.unique(pairs.pose):
            blocks.append(along * (pairs.pose == pose)[:, None])
            sigmas.append(np.full(joints, doubts.encoder_rad))
    return np.hstack(blocks), np.concatenate(sigmas)


def _prior(sigma: np.ndarray) -> Normal:
    return Normal(np.diag(sigma**-2.0), np.zeros(len(sigma)))


def _of_shapes(gain: np.ndarray, left: np.ndarray, pairs: Pairs, normals: np.ndarray) -> np.ndarray:
    """(6, 6) covariance due to shapes that differ from the model by more than an offset of each link.

    Such a difference is the same in all poses, so that more of them do not reduce it. It is taken as independent
    between the links and between the sides of a link (left, right, upper and lower, as the camera sees them), with
    the variance of the residuals `left` (N,) of the component.
    """
    side = (normals[:, 0] > 0) + 2 * (normals[:, 1] > 0)
    total = np.zeros((6, 6))
    _, patch = np.unique(4 * (pairs.part * 1000 + pairs.link) + side, return_inverse=True)
    for number in range(patch.max() + 1):
        own = patch == number
        part = pairs.part == pairs.part[own][0]
        by = gain[:, own].sum(axis=1)
        total += float((left[part] ** 2).mean()) * np.outer(by, by)
    return total


def _offsets(columns: np.ndarray, found: np.ndarray, pairs: Pairs, names: Sequence[str]) -> dict[str, float]:
    """Mean offset of the points of each component [m]."""
    size = sum(1 + len(np.unique(pairs.link[pairs.part == part])) for part in np.unique(pairs.part))
    by_offset = columns[:, 6 : 6 + size] @ found[6 : 6 + size]
    return {names[part]: float(by_offset[pairs.part == part].mean()) for part in np.unique(pairs.part)}


def _spread(arms: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Mean over the components of the mean over their points of J.T @ J, J the motion of a point by a twist of dT."""
    motions = lie.point_motions(arms)[:, :, :6]
    each = np.einsum("nik,nil->nkl", motions, motions)
    return np.asarray(np.mean([each[part == number].mean(axis=0) for number in np.unique(part)], axis=0))
