"""Which motions a joint can make: a turn about a line where both parts are, or a slide, and rather a small one."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import transforms

from .clouds import Cloud

SMALL_TURN = np.radians(2.0)
"""A smaller turn is a slide."""
PITCH_M = 0.008
"""Shift along the axis at which a turn is half as plausible [m]."""
NEAR_M = 0.015
"""Distance between an axis and the parts that it joins that needs no excuse [m]: hinges are partly hidden."""
FAR_M = 0.03
"""Further distance at which an axis is half as plausible [m]."""
ASKEW = np.radians(12.0)
"""Angle from plumb and level at which a direction is half as plausible [rad]."""
LARGE = 0.4
"""Way of the part, in sizes of the object, at which a motion is half as plausible."""


class Plausible:
    """Judges motions of a part relative to the part that stayed.

    Args:
        part: Points that moved.
        stayed: Points of the other part, in the same frame.
    """

    def __init__(self, part: Cloud, stayed: Cloud) -> None:
        from scipy.spatial import KDTree

        self._part, self._stayed = part.thinned(800), stayed.thinned(800)
        self._trees = KDTree(self._part.points), KDTree(self._stayed.points)
        points = np.concatenate([self._part.points, self._stayed.points])
        self._middle, self._size = points.mean(axis=0), float(np.linalg.norm(np.ptp(points, axis=0)))

    def __call__(self, motion: np.ndarray) -> float:
        """A factor in 0..1 for a (4, 4) motion."""
        points = self._part.points
        way = np.linalg.norm(transforms.apply(motion, points) - points, axis=1).mean()
        factor = 1.0 / (1.0 + (way / (LARGE * self._size)) ** 2)
        if transforms.angle(motion[:3, :3]) < SMALL_TURN:
            shift = transforms.apply(motion, self._middle) - self._middle
            return float(factor * _square(shift / max(float(np.linalg.norm(shift)), 1e-9)))
        factor *= 1.0 - 0.5 * (transforms.angle(motion[:3, :3]) / np.pi) ** 2
        axis, origin, pitch = axis_of(motion, self._middle)
        gap = max(0.0, self._gap(axis, origin) - NEAR_M)
        factor *= _square(axis)
        return float(factor / (1.0 + (pitch / PITCH_M) ** 2) / (1.0 + (gap / FAR_M) ** 2))

    def possible(self, motion: np.ndarray, unmoved_m: float = 0.0) -> bool:
        """Whether a (4, 4) motion is a slide, or a turn about a line where both parts are.

        Args:
            motion: The motion.
            unmoved_m: What moved by less counts for the part that stayed [m]: it is missing beside the axis.
        """
        angle = transforms.angle(motion[:3, :3])
        if angle < SMALL_TURN:
            return True
        axis, origin, pitch = axis_of(motion, self._middle)
        return abs(pitch) < 2.0 * PITCH_M and self._gap(axis, origin) < NEAR_M + 0.5 * FAR_M + unmoved_m / angle

    def _gap(self, axis: np.ndarray, origin: np.ndarray) -> float:
        """Distance of both parts from the place on the axis that is nearest to both [m]."""
        along = np.arange(-self._size, self._size, 0.006)
        places = origin + along[:, None] * axis
        distances = np.stack([np.asarray(tree.query(places)[0]) for tree in self._trees])
        return float(distances.max(axis=0).min())


def _square(direction: np.ndarray) -> float:
    """A factor for a unit direction in the world: most joints are plumb or level as things stand."""
    rise = np.arcsin(min(1.0, abs(float(direction[2]))))
    return float(1.0 / (1.0 + (min(rise, np.pi / 2.0 - rise) / ASKEW) ** 2))


def axis_of(motion: np.ndarray, near: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Unit axis (3,), its point nearest to `near` (3,) and the shift along it [m] of a (4, 4) motion that turns."""
    rotation, shift = motion[:3, :3], motion[:3, 3]
    skew = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    axis = skew / max(float(np.linalg.norm(skew)), 1e-12)
    pitch = float(axis @ shift)
    # Nothing turns along the axis; pinning that direction keeps the system regular.
    system = np.eye(3) - rotation + np.outer(axis, axis)
    return axis, np.linalg.solve(system, shift - axis * pitch + axis * (axis @ near)), pitch
