"""Retiming: a path is slowed, where it must be, to a robot's limits of speed and acceleration; it is never hastened."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import lie, transforms

NEAR = 4
"""Steps before and after one with too much acceleration that are made slower with it."""
ROUNDS = 400
"""Maximum number of corrections of the durations."""


@dataclass(frozen=True)
class Limits:
    """Limits of joints."""

    speed: np.ndarray
    """(A,) [rad/s or m/s]."""
    acceleration: np.ndarray
    """(A,) [rad/s^2 or m/s^2]."""


def durations(path: np.ndarray, least: np.ndarray, limits: Limits, before: np.ndarray, period_s: float) -> np.ndarray:
    """Durations of the steps of a path [control periods], the same or longer than `least`.

    Where two steps need too much acceleration between them, both are made longer, again and again, until the speeds
    rise and fall slowly enough everywhere.

    Args:
        path: (N + 1, A) joint positions [rad or m].
        least: (N,) shortest durations [control periods].
        limits: Limits of the joints.
        before: (A,) speed at the beginning [rad/s or m/s].
        period_s: Control period [s].
    """
    steps = np.diff(path, axis=0)
    found = np.maximum(least, (np.abs(steps) / (limits.speed * period_s)).max(axis=1, initial=0.0))
    for _ in range(ROUNDS):
        speeds = np.concatenate([before[None], steps / (found * period_s)[:, None]])
        spans = period_s * np.concatenate([found[:1], (found[1:] + found[:-1]) / 2])
        excess = (np.abs(np.diff(speeds, axis=0)) / spans[:, None] / limits.acceleration).max(axis=1)
        if excess.max(initial=0.0) <= 1.0 + 1e-3:
            break
        # A step after which motion is too fast is slowed together with the one that follows it.
        factor = np.clip(np.sqrt(excess), 1.0, 1.1)
        found = found * np.maximum(factor, np.append(factor[1:], 1.0))
    return np.asarray(found)


def moments(found: np.ndarray) -> np.ndarray:
    """Places on a path of N steps, 0..N, at the ends of whole control periods; the last one is N.

    Args:
        found: (N,) durations of its steps [control periods].
    """
    ends = np.concatenate([[0.0], np.cumsum(found)])
    count = max(1, int(np.ceil(ends[-1] - 1e-6)))
    return np.asarray(np.interp(ends[-1] * np.arange(1, count + 1) / count, ends, np.arange(len(ends))))


def accelerations(sent: np.ndarray, before: np.ndarray, period_s: float) -> np.ndarray:
    """Accelerations (N, A) of targets (N + 1, A), of which one is sent per control period.

    Args:
        sent: The targets [rad].
        before: (A,) their speed before [rad/s].
        period_s: Control period [s].
    """
    speeds = np.concatenate([before[None], np.diff(sent, axis=0) / period_s])
    return np.asarray(np.abs(np.diff(speeds, axis=0)) / period_s)


def slower(found: np.ndarray, places: np.ndarray, excess: np.ndarray) -> np.ndarray:
    """Longer durations of the steps near places (M,) at which motion is too fast by factors (M,)."""
    longer = found.copy()
    for place, factor in zip(places, excess, strict=True):
        if factor > 1.0:
            near = slice(max(0, int(place) - NEAR), int(place) + NEAR)
            longer[near] = np.maximum(longer[near], found[near] * min(factor, 1.5))
    return longer


def pose_at(path: np.ndarray, place: float) -> np.ndarray:
    """Pose (4, 4) at a place 0..N of a path (N + 1, 4, 4), smooth in velocity and exact at whole places."""
    row = min(int(place), len(path) - 2) if len(path) > 1 else 0
    part = place - row
    if part <= 1e-9 or len(path) == 1:
        return np.asarray(path[row])
    if part >= 1.0 - 1e-9:
        return np.asarray(path[row + 1])
    rows = [max(row - 1, 0), row, row + 1, min(row + 2, len(path) - 1)]
    here = path[row]
    # Displacements from the pose at `row`, small enough to be vectors.
    parts = [np.concatenate([path[k][:3, 3], lie.rotation_vector(here[:3, :3].T @ path[k][:3, :3])]) for k in rows]
    moved = _cubic(parts, part)
    return transforms.rigid(here[:3, :3] @ lie.rotation(moved[3:]), moved[:3])


def _cubic(values: list[np.ndarray], part: float) -> np.ndarray:
    """The cubic through the second and the third of four values, with central differences as slopes."""
    before, one, other, after = values
    first, last = (other - before) / 2, (after - one) / 2
    return np.asarray(
        (2 * part**3 - 3 * part**2 + 1) * one
        + (part**3 - 2 * part**2 + part) * first
        + (3 * part**2 - 2 * part**3) * other
        + (part**3 - part**2) * last
    )
