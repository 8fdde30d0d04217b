"""Covariance of the correction by balanced ICP: from its residuals, and from errors that residuals do not show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import lie
from dextera_build.geometry.robot_pairs import Pairs

INDEPENDENT = 40.0
"""Effective number of independent measurements of a link's points in one pose."""


@dataclass(frozen=True)
class Doubts:
    """Standard deviations of joint and surface errors [rad, m]."""

    joint_rad: float = 0.0
    """Zero offset of each joint, the same in all poses [rad]."""
    encoder_rad: float = 0.0
    """Error of each joint reading [rad]."""
    surface_m: float = 0.0003
    """Distance of a link's surface from its model, along its normals [m]; matching itself leaves 0.2 mm on round
    fingers."""


def views(pairs: Pairs) -> np.ndarray:
    """A number (N,) for each link of each component in each pose."""
    return np.asarray((pairs.part * 1000 + pairs.link) * 10000 + pairs.pose)


def covariance(
    row: np.ndarray, off: np.ndarray, weight: np.ndarray, pairs: Pairs, motion: np.ndarray, doubts: Doubts
) -> np.ndarray:
    """(6, 6) covariance about the centre of the points, from the residuals and from joint errors.

    A zero offset of the first joint is a rotation of the base, which no residual shows; its stated value is used.
    """
    inverse = np.linalg.pinv(row.T @ (row * weight[:, None]), rcond=1e-12)
    total = np.zeros((6, 6))
    # Errors of neighbouring pixels are correlated, so thousands of points of a link in a pose count as few
    # measurements.
    _, cluster, count = np.unique(views(pairs), return_inverse=True, return_counts=True)
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
    row: np.ndarray, off: np.ndarray, weight: np.ndarray, pairs: Pairs, part: int, stated: float
) -> np.ndarray:
    """(6, 6) covariance due to links larger or smaller than their model, from the mean residuals of the links."""
    groups = [
        np.flatnonzero((pairs.part == part) & (pairs.link == link) & (weight > 0)) for link in np.unique(pairs.link)
    ]
    groups = [own for own in groups if len(own)]
    if not groups:
        return np.zeros((6, 6))
    # The fit absorbs a part of the offsets, as any six parameters do.
    left = max(len(groups) - 3, 1) / len(groups)
    shown = np.average([off[own].mean() ** 2 for own in groups], weights=[weight[own].sum() for own in groups]) / left
    each = np.array([(row[own] * weight[own, None]).sum(axis=0) for own in groups])
    # All links of a component may have a common error: covers over all of them, or the depth camera's bias.
    return np.asarray(max(stated**2, float(shown)) * (each.T @ each + np.outer(each.sum(axis=0), each.sum(axis=0))))


def moved(about: np.ndarray, middle: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Covariance of dT from that of a translation and a rotation about the centre of the points."""
    # dT = Exp(dr) about `middle`, so its translation also moves by dr x (t - middle).
    by = lie.adjoint(motion[:3, 3] - middle)
    return np.asarray(by @ about @ by.T)
