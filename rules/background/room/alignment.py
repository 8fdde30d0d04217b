"""The similarity between two sets of poses of the same cameras."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import transforms

LEAST_SPREAD = 1e-6
"""Minimum spread of the cameras about their centre, relative to their distance from the origin, that determines a
scale."""


def between(source: np.ndarray, target: np.ndarray) -> tuple[float, np.ndarray, float]:
    """Scale s and rigid motion (4, 4) with target = motion @ (s * source), and the largest residual of a centre.

    The rotation is the mean over all cameras (chordal; Hartley et al. 2013), so that collinear cameras suffice; scale
    and translation are the least squares of the centres.

    Args:
        source: (N, 4, 4) poses in the frame of unknown pose and scale.
        target: (N, 4, 4) poses of the same cameras in the wanted frame [m].

    Returns:
        Scale, motion, and the largest distance [m] of a moved centre from its target.

    Raises:
        ValueError: The centres of the cameras coincide, so that the scale is undetermined.
    """
    u, _, vt = np.linalg.svd(np.einsum("nij,nkj->ik", target[:, :3, :3], source[:, :3, :3]))
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    start, end = source[:, :3, 3] @ turn.T, target[:, :3, 3]
    arms, wanted = start - start.mean(axis=0), end - end.mean(axis=0)
    scale = float((arms * wanted).sum() / max((arms**2).sum(), 1e-300))
    for centres, offsets in ((start, arms), (end, wanted)):
        if np.abs(offsets).max() <= LEAST_SPREAD * max(np.abs(centres).max(), 1e-9):
            raise ValueError("all cameras are at one place")
    if scale <= 0.0:
        raise ValueError("the cameras are mirrored")
    motion = transforms.rigid(turn, end.mean(axis=0) - scale * start.mean(axis=0))
    left = transforms.apply(motion, scale * source[:, :3, 3]) - end
    return scale, motion, float(np.linalg.norm(left, axis=1).max())
