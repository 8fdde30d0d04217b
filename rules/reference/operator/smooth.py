"""Motions of a hand between moments of control: other rates, and ways to a start."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Motion(NamedTuple):
    """A hand over time at an even rate."""

    wrist: np.ndarray
    """(N, 7) position [m] and unit quaternion w x y z."""
    angles: np.ndarray
    """(N, 5, 4) angles of the fingers [rad]."""


def resampled(motion: Motion, rate_hz: float, wanted_hz: float) -> Motion:
    """The motion at another rate, by cubic interpolation with continuous speed (Catmull-Rom)."""
    count = len(motion.wrist)
    times = np.arange(round((count - 1) / rate_hz * wanted_hz) + 1) * rate_hz / wanted_hz
    return Motion(_unit(_cubic(_aligned(motion.wrist), times)), _cubic(motion.angles, times))


def way(start: Motion, end: Motion, count: int) -> Motion:
    """N moments from the last moment of one motion to just before the first of another, with least jerk."""
    share = np.arange(count) / max(1, count)
    share = share**3 * (10 - 15 * share + 6 * share**2)
    wrists = _aligned(np.stack([start.wrist[-1], end.wrist[0]]))
    wrist = wrists[0] + share[:, None] * (wrists[1] - wrists[0])
    angles = start.angles[-1] + share[:, None, None] * (end.angles[0] - start.angles[-1])
    return Motion(_unit(wrist), angles)


def held(motion: Motion, row: int, count: int) -> Motion:
    """N times one moment."""
    return Motion(np.repeat(motion.wrist[[row]], count, axis=0), np.repeat(motion.angles[[row]], count, axis=0))


def joined(parts: list[Motion]) -> Motion:
    """Motions one after the other."""
    return Motion(np.concatenate([part.wrist for part in parts]), np.concatenate([part.angles for part in parts]))


def _cubic(rows: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Values at times in units of rows."""
    last = len(rows) - 1
    at = np.clip(times.astype(np.int64), 0, max(last - 1, 0))
    share = (times - at).reshape(-1, *[1] * (rows.ndim - 1))
    if last < 1:
        return np.repeat(rows, len(times), axis=0)
    ends = np.concatenate([2 * rows[:1] - rows[1:2], rows, 2 * rows[-1:] - rows[-2:-1]])
    before, first, second, after = (ends[at + step] for step in range(4))
    speed, end = (second - before) / 2, (after - first) / 2
    change = second - first
    return np.asarray(
        first + share * (speed + share * (3 * change - 2 * speed - end + share * (speed + end - 2 * change)))
    )


def _aligned(poses: np.ndarray) -> np.ndarray:
    """Poses (N, 7) whose quaternions have no jumps of sign."""
    flips = np.cumprod(np.concatenate([[1.0], np.sign((poses[1:, 3:] * poses[:-1, 3:]).sum(axis=1) + 1e-12)]))
    return np.hstack([poses[:, :3], poses[:, 3:] * flips[:, None]])


def _unit(poses: np.ndarray) -> np.ndarray:
    return np.hstack([poses[:, :3], poses[:, 3:] / np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)])
