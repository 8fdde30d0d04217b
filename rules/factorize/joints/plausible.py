"""Plausibility of joint motions: rotations about a line near both parts, or translations, preferably small."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import transforms

from .clouds import Cloud

SMALL_TURN = np.radians(2.0)
"""Smaller rotations are treated as translations [rad]."""
PITCH_M = 0.008
"""Translation along the axis at which a rotation is half as plausible [m]."""
NEAR_M = 0.015
"""Distance between an axis and its parts without a penalty [m], because hinges are partly hidden."""
FAR_M = 0.03
"""Additional distance at which an axis is half as plausible [m]."""
ASKEW = np.radians(12.0)
"""Angle from the vertical or horizontal at which a direction is half as plausible [rad]."""
LARGE = 0.4
"""Displacement of the part, in sizes of the object, at which a motion is half as plausible."""


class Plausible:
    """Judges motions of a part relative to the fixed part.

    Args:
        part: Points of the moved part.
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
        """Whether a (4, 4) motion is a translation, or a rotation about a line near both parts.

        Args:
            motion: The motion.
            unmoved_m: Points that move by less are assigned to the fixed part [m], so points near the axis are missing.
        """
        angle = transforms.angle(motion[:3, :3])
        if angle < SMALL_TURN:
            return True
        axis, origin, pitch = axis_of(motion, self._middle)
        return abs(pitch) < 2.0 * PITCH_M and self._gap(axis, origin) < NEAR_M + 0.5 * FAR_M + unmoved_m / angle

    def _gap(self, axis: np.ndarray, origin: np.ndarray) -> float:
        """Distance of both parts from the point of the axis that is nearest to both [m]."""
        along = np.arange(-self._size, self._size, 0.006)
        places = origin + along[:, None] * axis
        distances = np.stack([np.asarray(tree.query(places)[0]) for tree in self._trees])
        return float(distances.max(axis=0).min())


def _square(direction: np.ndarray) -> float:
    """Factor for a unit direction in the world: most joint axes are vertical or horizontal."""
    rise = np.arcsin(min(1.0, abs(float(direction[2]))))
    return float(1.0 / (1.0 + (min(rise, np.pi / 2.0 - rise) / ASKEW) ** 2))


def axis_of(motion: np.ndarray, near: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Unit axis (3,) of a (4, 4) motion, its point nearest to `near` (3,), and the translation along it [m]."""
    rotation, shift = motion[:3, :3], motion[:3, 3]
    skew = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    axis = skew / max(float(np.linalg.norm(skew)), 1e-12)
    pitch = float(axis @ shift)
    # A rotation moves nothing along its axis; pinning that direction keeps the system regular.
    system = np.eye(3) - rotation + np.outer(axis, axis)
    return axis, np.linalg.solve(system, shift - axis * pitch + axis * (axis @ near)), pitch
