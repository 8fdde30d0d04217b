"""The fixed part of an object: its motion on the support between two sights."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import lie, transforms

from .clouds import Sight
from .matching import Target, best, clear

CARRIED = 0.15
"""Motion of the whole object between two sights, as a fraction of its size, at which it is half as plausible."""
TILT = np.radians(2.0)
"""Angle between two measurements of the support at which a motion on it is half as plausible [rad]."""
RISE_M = 0.004
"""Difference between the heights of the supports at which a motion is half as plausible [m]."""
SOME = 800
"""Points used to test whether a part would be in empty space."""


def beside(source: Sight) -> list[np.ndarray]:
    """Small motions on the support (4, 4): translations by up to 3 cm and rotations by up to 5 degrees."""
    middle = source.inner.points.mean(axis=0)
    found = []
    for angle in np.radians([0.0, 5.0, -5.0]):
        turn = lie.rotation(np.array([0.0, 0.0, angle]))
        shifts = (
            np.array([x, y, 0.0]) for x in (0.0, 0.015, -0.015, 0.03, -0.03) for y in (0.0, 0.015, -0.015, 0.03, -0.03)
        )
        found += [transforms.rigid(turn, middle - turn @ middle + shift) for shift in shifts]
    return found


def standing(source: Sight, target: Target) -> np.ndarray:
    """The (4, 4) motion on the support that registers most of `source` to `target`: that of the fixed part.

    It starts with small motions and rotations about the centre, and ends with unconstrained steps, because the two
    supports were measured separately.
    """
    middle, other = np.median(source.inner.points, axis=0), np.median(target.sight.inner.points, axis=0)
    shifts = [np.zeros(3), (other - middle) * [1.0, 1.0, 0.0]]
    starts = []
    for angle in np.radians([0, 8, -8, 18, -18, 30, -30, 60, -60, 90, -90, 120, -120, 150, -150, 180]):
        turn = lie.rotation(np.array([0.0, 0.0, angle]))
        starts += [transforms.rigid(turn, middle - turn @ middle + shift) for shift in shifts]
    points = source.inner.thinned(200).points
    size = float(np.linalg.norm(np.ptp(points, axis=0)))

    def near(motion: np.ndarray) -> float:
        way = float(np.linalg.norm(transforms.apply(motion, points) - points, axis=1).mean())
        return level(motion, points) / (1.0 + (way / (CARRIED * size)) ** 2)

    return best(starts, source, target, lie.PLANAR, worth=near, close=tuple(beside(source)))


def settled(part: Sight, target: Target, start: np.ndarray) -> np.ndarray:
    """The (4, 4) motion on the support, near `start`, of a fixed part."""
    points, eye = part.inner.thinned(SOME).points, target.sight.eye
    return best(
        [start],
        part,
        target,
        lie.PLANAR,
        close=tuple(start @ motion for motion in beside(part)),
        worth=lambda motion: level(motion, points) * clear(eye, motion, points),
    )


def level(motion: np.ndarray, points: np.ndarray) -> float:
    """Factor for (4, 4) motions of points (N, 3) that stay on a support, unlike those of an opened lid."""
    tilt = float(np.arccos(np.clip(motion[2, 2], -1.0, 1.0)))
    rise = float((transforms.apply(motion, points) - points)[:, 2].mean())
    return float(1.0 / (1.0 + (tilt / TILT) ** 2) / (1.0 + (rise / RISE_M) ** 2))
