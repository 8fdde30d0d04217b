"""How well balanced ICP knows its correction: by its residuals, and by what these do not show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import transforms
from dextera_build.geometry.robot_pairs import Pairs

INDEPENDENT = 40.0
"""Measurements that the points of a link in one pose count as, however many they are."""


@dataclass(frozen=True)
class Doubts:
    """What is known of the joints' errors, as standard deviations [rad]."""

    joint_rad: float = 0.0
    """Of each joint's zero, the same in all poses."""
    encoder_rad: float = 0.0
    """Of each reading."""
    surface_m: float = 0.0003
    """Of a link's surface from its model's, along its normals; matching itself leaves 0.2 mm on round fingers."""


def covariance(
    row: np.ndarray, off: np.ndarray, weight: np.ndarray, pairs: Pairs, motion: np.ndarray, doubts: Doubts
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
    row: np.ndarray, off: np.ndarray, weight: np.ndarray, pairs: Pairs, part: int, stated: float
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


def moved(about: np.ndarray, middle: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Covariance of dT from that of a translation and a rotation about the points' middle."""
    # dT = Exp(dr) about `middle`, so its translation also moves by dr x (t - middle).
    by = np.eye(6)
    by[:3, 3:] = -transforms.cross_matrix(motion[:3, 3] - middle)
    return np.asarray(by @ about @ by.T)
