"""Statistics of success rates: confidence intervals, and how well one world predicts another.

Rates are fractions from 0 to 1. All functions are deterministic.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np

Z90 = NormalDist().inv_cdf(0.95)
"""Half width of a central 90 % interval of a normal distribution, in standard deviations."""


def wilson(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Score interval of a success rate (Wilson 1927), within [0, 1]; (0, 1) without trials."""
    if trials == 0:
        return 0.0, 1.0
    z = _quantile(confidence)
    rate = successes / trials
    scale = 1.0 + z * z / trials
    middle = (rate + z * z / (2 * trials)) / scale
    half = z * math.sqrt(rate * (1 - rate) / trials + z * z / (4 * trials * trials)) / scale
    low = 0.0 if successes == 0 else max(0.0, middle - half)
    high = 1.0 if successes == trials else min(1.0, middle + half)
    return low, high


def bootstrap(
    values: np.ndarray, draws: int, confidence: float, seed: int, of: Callable[..., Any] = np.mean
) -> tuple[float, float]:
    """Percentile bootstrap interval of the mean, or of the statistic `of`, of (N,) values, N >= 1."""
    picks = np.random.default_rng(seed).integers(0, len(values), size=(draws, len(values)))
    tail = (1.0 - confidence) / 2.0
    low, high = np.quantile(of(values[picks], axis=1), [tail, 1.0 - tail])
    return float(low), float(high)


@dataclass(frozen=True)
class Rate:
    """Successes among trials."""

    successes: int
    trials: int

    @property
    def value(self) -> float:
        """Fraction of successes; 0 without trials."""
        return self.successes / self.trials if self.trials else 0.0

    def interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Wilson interval."""
        return wilson(self.successes, self.trials, confidence)

    def __str__(self) -> str:
        low, high = self.interval()
        return f"{self.successes}/{self.trials} ({100 * low:.0f}-{100 * high:.0f} %)"


def mean(rates: Sequence[Rate], confidence: float = 0.95) -> tuple[float, float, float] | None:
    """Unweighted mean and its interval, derived from the intervals of the rates; None without rates.

    Squared distances to the Wilson limits are added like variances (MOVER, Zou and Donner 2008), so trials are not
    pooled across tasks: 13 tasks of 20 trials are not 260 trials of one task.
    """
    if not rates:
        return None
    values = np.array([rate.value for rate in rates])
    lows, highs = np.array([rate.interval(confidence) for rate in rates]).T
    middle, weight = float(values.mean()), 1.0 / len(rates)
    below = weight * float(np.sqrt(((values - lows) ** 2).sum()))
    above = weight * float(np.sqrt(((highs - values) ** 2).sum()))
    return middle, max(0.0, middle - below), min(1.0, middle + above)


def pearson(one: Sequence[float], other: Sequence[float]) -> float | None:
    """Correlation coefficient; None for fewer than three points or a constant series."""
    a, b = np.asarray(one, np.float64), np.asarray(other, np.float64)
    if a.shape != b.shape:
        raise ValueError(f"{len(a)} numbers stand against {len(b)}")
    if len(a) < 3 or np.ptp(a) == 0 or np.ptp(b) == 0:
        return None
    a, b = a - a.mean(), b - b.mean()
    return float(np.clip(a @ b / math.sqrt(float(a @ a) * float(b @ b)), -1.0, 1.0))


def pearson_interval(r: float, points: int, confidence: float = 0.95) -> tuple[float, float] | None:
    """Interval of a correlation coefficient by Fisher's transformation; None for fewer than four points or |r| = 1.

    Assumes independent, jointly normal points; cells that share a task or a policy are neither.
    """
    if points < 4 or abs(r) >= 1.0 - 1e-12:
        return None
    half = _quantile(confidence) / math.sqrt(points - 3)
    return math.tanh(math.atanh(r) - half), math.tanh(math.atanh(r) + half)


def mmrv(simulated: Sequence[float], measured: Sequence[float]) -> float | None:
    """Mean maximum rank violation (Li et al. 2024, SIMPLER): mean_i max_j |R_i - R_j| 1[(S_i < S_j) != (R_i < R_j)].

    Args:
        simulated: S, rates in the predicting world.
        measured: R, rates in the predicted world, in the same order.

    Returns:
        0 if both worlds have the same ranking; None for fewer than two points.
    """
    s, r = np.asarray(simulated, np.float64), np.asarray(measured, np.float64)
    if s.shape != r.shape:
        raise ValueError(f"{len(s)} numbers stand against {len(r)}")
    if len(s) < 2:
        return None
    violated = (s[:, None] < s[None, :]) != (r[:, None] < r[None, :])
    return float((np.abs(r[:, None] - r[None, :]) * violated).max(axis=1).mean())


@dataclass(frozen=True)
class Paired:
    """Counts of two series of verdicts on the same starts."""

    both: int
    """Both succeeded."""
    first: int
    """Only the first succeeded."""
    second: int
    """Only the second succeeded."""
    neither: int
    """Both failed."""

    @property
    def p(self) -> float:
        """Two-sided p of McNemar's exact test: probability of a split at least this uneven if neither is better."""
        count, fewer = self.first + self.second, min(self.first, self.second)
        tail = sum(math.comb(count, k) for k in range(fewer + 1))
        return float(min(1.0, 2 * tail / 2**count))


def paired(first: Sequence[bool], second: Sequence[bool]) -> Paired:
    """Compare two series of verdicts start by start."""
    if len(first) != len(second):
        raise ValueError(f"{len(first)} verdicts stand against {len(second)}")
    pairs = [(bool(a), bool(b)) for a, b in zip(first, second, strict=True)]
    return Paired(
        both=pairs.count((True, True)),
        first=pairs.count((True, False)),
        second=pairs.count((False, True)),
        neither=pairs.count((False, False)),
    )


def _quantile(confidence: float) -> float:
    return NormalDist().inv_cdf(0.5 + confidence / 2)
