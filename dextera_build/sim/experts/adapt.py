"""Adaptation of poses to a new frame (Eq. 4a to 4c of the paper)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dextera_build.geometry import transforms
from dextera_build.sim.experts.motion import between


@dataclass(frozen=True)
class Timing:
    """Speed of interpolated motion."""

    speed_m_s: float = 0.35
    """Speed of the palm [m/s]."""
    turn_rad_s: float = 1.2
    """Angular speed of the palm [rad/s]."""


def transfer(poses: np.ndarray, source_frame: np.ndarray, new_frame: np.ndarray) -> np.ndarray:
    """Eq. 4a: T_new(t) = T_F_new (T_F_src)^-1 T_src(t).

    Args:
        poses: (T, 4, 4) T_src(t), the palm in the source.
        source_frame: (4, 4) T_F_src.
        new_frame: (4, 4) T_F_new, in the same base as the others.
    """
    return np.asarray((new_frame @ transforms.invert(source_frame)) @ poses)


def bent(path: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Bend a free motion to lead from `start` to `end` (Eq. 4b and 4c).

    Every waypoint interpolates between the path moved to `start` and the path moved to `end`, by its fraction of the
    path's length; an arc around an obstacle stays an arc.

    Args:
        path: (N, 4, 4) demonstrated poses.
        start: (4, 4) new first pose.
        end: (4, 4) new last pose.
    """
    first, last = start @ transforms.invert(path[0]), end @ transforms.invert(path[-1])
    length = np.concatenate([[0.0], np.cumsum(_lengths(path))])
    parts = length / length[-1] if length[-1] > 0 else np.linspace(0.0, 1.0, len(path))
    return np.array([between(first @ pose, last @ pose, part) for pose, part in zip(path, parts, strict=True)])


def slowed(shown: np.ndarray, path: np.ndarray) -> float:
    """Factor, at least 1, by which `path` is slowed so that no step is faster than in `shown`, (N, 4, 4) each."""
    return max(1.0, float(_lengths(path).max() / max(_lengths(shown).max(), 1e-9)))


def _lengths(path: np.ndarray) -> np.ndarray:
    """Lengths of steps (N - 1,); metres and radians count equally, as for a point one metre from the palm."""
    turns = [transforms.angle(one[:3, :3].T @ other[:3, :3]) for one, other in pairwise(path)]
    return np.asarray(np.linalg.norm(np.diff(path[:, :3, 3], axis=0), axis=1) + turns)


def steps_between(first: np.ndarray, last: np.ndarray, rate_hz: float, timing: Timing) -> int:
    """Number of control steps, at least 1, from pose `first` to `last`, (4, 4) each, at the speed limits."""
    seconds = max(
        float(np.linalg.norm(last[:3, 3] - first[:3, 3])) / timing.speed_m_s,
        transforms.angle(first[:3, :3].T @ last[:3, :3]) / timing.turn_rad_s,
    )
    return max(1, int(np.ceil(seconds * rate_hz)))
