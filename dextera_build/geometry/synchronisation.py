"""Synchronisation of recordings of two devices: clock offset, and moments of rest."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

BLOCKS = 8
"""Number of parts of a recording that are left out in turn to estimate a spread."""
WINDOW_S = 0.2
"""Time window of a speed [s], so that encoder noise is not motion."""


class Offset(NamedTuple):
    """Difference of two clocks."""

    seconds: float
    """Time of the joints minus time of the pictures, at the same moment [s]."""
    sigma: float
    """Its standard deviation, by leaving out parts of the recording (jackknife) [s]."""
    correlation: float
    """Correlation of changes in the pictures with joint motion, at this offset."""
    rival: float
    """Largest correlation at any other local maximum, which repetitive motions have."""


def clock_offset(
    pictures: np.ndarray, changes: np.ndarray, stamps: np.ndarray, positions: np.ndarray, reach_s: float
) -> Offset | None:
    """Offset at which picture changes and joint motion correlate best; None without motion or with too little data.

    Args:
        pictures: (N,) times of pictures, increasing [s].
        changes: (N - 1,) difference of each picture from the previous one, any unit.
        stamps: (M,) times of joint measurements, increasing [s].
        positions: (M, J) joint positions [rad or m].
        reach_s: Largest offset that is searched [s].
    """
    if len(pictures) < 4 * BLOCKS or len(stamps) < 4 * BLOCKS:
        return None
    path = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1)))
    step = float(np.median(np.diff(pictures))) / 8
    lags = np.arange(-np.ceil(reach_s / step), np.ceil(reach_s / step) + 1) * step
    moved = np.array([np.diff(np.interp(pictures + lag, stamps, path)) for lag in lags])
    seen = np.sqrt(np.maximum(changes - np.quantile(changes, 0.1), 0.0))
    if path[-1] < 1e-6 or seen.std() < 1e-12:
        return None
    scores = _correlations(np.sqrt(moved), seen, np.ones(len(seen), bool))
    best = _peak(lags, scores)
    parts = np.array_split(np.arange(len(seen)), BLOCKS)
    found = []
    for part in parts:
        kept = np.ones(len(seen), bool)
        kept[part] = False
        found.append(_peak(lags, _correlations(np.sqrt(moved), seen, kept)))
    spread = np.array(found)
    sigma = float(np.sqrt((BLOCKS - 1) / BLOCKS * ((spread - spread.mean()) ** 2).sum()))
    # A jackknife of lags on a grid can be 0 by chance; the resolution of the grid cannot.
    return Offset(best, float(np.hypot(sigma, step / np.sqrt(12.0))), float(scores.max()), _rival(scores))


def _correlations(moved: np.ndarray, seen: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """(L,) correlations of each row of (L, N) with (N,)."""
    rows = moved[:, kept] - moved[:, kept].mean(axis=1, keepdims=True)
    column = seen[kept] - seen[kept].mean()
    norms = np.linalg.norm(rows, axis=1) * np.linalg.norm(column)
    return np.asarray(rows @ column / np.maximum(norms, 1e-12))


def _peak(lags: np.ndarray, scores: np.ndarray) -> float:
    """Position of the maximum, interpolated by a parabola."""
    top = int(scores.argmax())
    if not 0 < top < len(scores) - 1:
        return float(lags[top])
    before, at, after = scores[top - 1 : top + 2]
    bend = before - 2 * at + after
    return float(lags[top] + (lags[1] - lags[0]) * (0.5 * (before - after) / bend if bend < 0 else 0.0))


def _rival(scores: np.ndarray) -> float:
    """The highest other local maximum, without the slope of the highest one."""
    top = int(scores.argmax())
    low, high = top, top
    while low > 0 and scores[low - 1] <= scores[low]:
        low -= 1
    while high < len(scores) - 1 and scores[high + 1] <= scores[high]:
        high += 1
    rest = np.concatenate([scores[:low], scores[high + 1 :]])
    return float(rest.max(initial=0.0))


def rests(stamps: np.ndarray, positions: np.ndarray, slow: float, shortest_s: float) -> list[tuple[float, float]]:
    """First and last times [s] of intervals without joint motion; a gap in the measurements ends an interval.

    Args:
        stamps: (M,) times, increasing [s].
        positions: (M, J) [rad or m].
        slow: Largest speed at rest [rad/s or m/s].
        shortest_s: Minimum duration of an interval [s].
    """
    half = WINDOW_S / 2
    at = [np.stack([np.interp(stamps + side, stamps, each) for each in positions.T], axis=1) for side in (-half, half)]
    spans = np.minimum(stamps + half, stamps[-1]) - np.maximum(stamps - half, stamps[0])
    speeds = np.abs(at[1] - at[0]).max(axis=1) / np.maximum(spans, 1e-9)
    still = np.append(speeds <= slow, False)
    torn = np.append(np.diff(stamps, prepend=stamps[0]) > WINDOW_S, True)  # motion during a gap is unknown
    found, start = [], None
    for row, quiet in enumerate(still):
        if start is not None and (torn[row] or not quiet):
            if stamps[row - 1] - stamps[start] >= shortest_s:
                found.append((float(stamps[start]), float(stamps[row - 1])))
            start = None
        if quiet and start is None:
            start = row
    return found


def nearest_gap(times: np.ndarray, stamps: np.ndarray) -> np.ndarray:
    """(K,) distance [s] of times (K,) from the nearest of increasing stamps (M,)."""
    right = np.clip(np.searchsorted(stamps, times), 1, max(1, len(stamps) - 1))
    left = right - 1
    return np.asarray(
        np.minimum(np.abs(times - stamps[left]), np.abs(times - stamps[np.minimum(right, len(stamps) - 1)]))
    )
