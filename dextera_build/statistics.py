"""Statistics of success rates: confidence intervals, tests, and how well one world predicts another.

Rates are fractions from 0 to 1. All functions are deterministic. Intervals of Wilson and p-values hold for a number of
trials that was chosen beforehand; `evidence` and `confidence_sequence` hold whenever one stops.
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


def wilson(successes: float, trials: float, confidence: float = 0.95) -> tuple[float, float]:
    """Score interval of a success rate (Wilson 1927), within [0, 1]; (0, 1) without trials.

    Of a sum of numbers from 0 to 1 it is too wide rather than too narrow: their variance is at most that of successes
    and failures with the same mean.
    """
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


def evidence(total: float, trials: int, rate: float) -> float:
    """E-value against the mean `rate`: wealth of a gambler who bets on trials, with all alternatives mixed evenly.

    While every trial has the mean `rate`, given the earlier ones, the wealth ever reaches 1 / alpha with a probability
    of at most alpha (Ville 1939), so that one may stop at any time. The bets are likelihood ratios of success and
    failure; for numbers between 0 and 1 the wealth grows no faster, because a ratio is convex in the result.

    Args:
        total: Sum of the results, each from 0 to 1: the successes.
        trials: Their number.
        rate: The mean that is tested, 0 < rate < 1.
    """
    return math.exp(min(_log_evidence(total, trials, rate), 700.0))


def confidence_sequence(total: float, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Interval of a mean that holds after every number of trials at once: the means not refuted by `evidence`.

    Args:
        total: Sum of the results, each from 0 to 1.
        trials: Their number; (0, 1) without any.
        confidence: Probability that the mean is in the intervals of all numbers of trials.
    """
    most, mean = -math.log(1.0 - confidence), total / trials if trials else 0.0

    def end(outer: float) -> float:
        inner = mean
        for _ in range(50):
            middle = 0.5 * (inner + outer)
            refuted = _log_evidence(total, trials, middle) > most
            inner, outer = (inner, middle) if refuted else (middle, outer)
        return outer

    return 0.0 if total <= 0 else end(0.0), 1.0 if total >= trials else end(1.0)


@dataclass(frozen=True)
class Rate:
    """Successes among trials."""

    successes: float
    trials: float
    """Fractional for an estimate that is worth as many trials, see `joined`."""
    stopped: bool = False
    """Whether the results decided when the trials ended; the interval is then that of `confidence_sequence`."""

    @property
    def value(self) -> float:
        """Fraction of successes; 0 without trials."""
        return self.successes / self.trials if self.trials else 0.0

    def interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Wilson interval, or that of a confidence sequence."""
        if self.stopped:
            return confidence_sequence(self.successes, int(self.trials), confidence)
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
    """Mean maximum rank violation (Li et al. 2024, SIMPLER): mean_i max_j |R_i - R_j| 1[(S_i > S_j) != (R_i > R_j)].

    With `>` as in the published code [SimplerEnv: simpler_env/utils/metrics.py]; the formula of the paper has `<`. They
    differ in ties: here two points that are equal in S and not in R violate the rank of the one with the greater R.

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
    violated = (s[:, None] > s[None, :]) != (r[:, None] > r[None, :])
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

    @property
    def e(self) -> float:
        """E-value of "neither is better", whenever the trials ended: the starts that only one solves are fair coins."""
        return evidence(self.first, self.first + self.second, 0.5)

    def difference(self, confidence: float = 0.95) -> tuple[float, float, float]:
        """By how much more often the first succeeds, -1 to 1, and its interval; -1 to 1 without starts.

        Distances to the Wilson limits of both rates are added like correlated errors (Newcombe 1998, Statistics in
        Medicine 17, 2635-2650, method 10), so pairs that agree narrow the interval.
        """
        starts = self.both + self.first + self.second + self.neither
        if not starts:
            return 0.0, -1.0, 1.0
        one, other = self.both + self.first, self.both + self.second
        low, high = wilson(one, starts, confidence)
        other_low, other_high = wilson(other, starts, confidence)
        rate, other_rate, alike = one / starts, other / starts, self._alike(starts)
        found = (self.first - self.second) / starts
        below = _apart(rate - low, other_high - other_rate, alike)
        above = _apart(high - rate, other_rate - other_low, alike)
        return found, max(-1.0, found - below), min(1.0, found + above)

    def _alike(self, starts: int) -> float:
        """Correlation of the verdicts, corrected for continuity where it is above 0."""
        one, other = self.both + self.first, self.both + self.second
        margins = one * (starts - one) * other * (starts - other)
        excess = self.both * self.neither - self.first * self.second
        return (max(0.0, excess - starts / 2) if excess > 0 else excess) / math.sqrt(margins) if margins else 0.0


def mean_difference(pairs: Sequence[Paired], confidence: float = 0.95) -> tuple[float, float, float]:
    """Unweighted mean of the differences of one task or more, and its interval, added up as in `mean`."""
    values, lows, highs = np.array([each.difference(confidence) for each in pairs]).T
    middle, weight = float(values.mean()), 1.0 / len(pairs)
    below = weight * float(np.sqrt(((values - lows) ** 2).sum()))
    above = weight * float(np.sqrt(((highs - values) ** 2).sum()))
    return middle, max(-1.0, middle - below), min(1.0, middle + above)


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


def decided(first: Sequence[bool], second: Sequence[bool], alpha: float = 0.05) -> int | None:
    """Number of starts after which one of two series is the better one; None if it stays open.

    If neither is better, this happens with a probability of at most `alpha`, however many starts follow.

    Args:
        first: Verdicts in the order in which they came.
        second: Verdicts on the same starts.
        alpha: Probability of a wrong decision.
    """
    wins = np.array([0, 0])
    for number, (one, other) in enumerate(zip(first, second, strict=True), 1):
        wins += (one and not other, other and not one)
        if one != other and Paired(0, int(wins[0]), int(wins[1]), 0).e >= 1.0 / alpha:
            return number
    return None


SMOOTHING = 1.0
"""Starts added to each of the four cells of pairs in `joined`: few pairs agree by chance."""


def joined(pairs: Paired, rest: Rate) -> Rate:
    """Success rate in the second of two worlds, from trials in both and from more trials in the first alone.

    The prediction-powered estimate with the weight of least variance (Angelopoulos et al. 2023, PPI++; Badithela et al.
    2025 for robots): the rate in the second world, corrected by how much the first world's rate of the pairs differs
    from that of the rest. Its variance is that of n pairs times 1 - r^2 N / (N + n), with r their correlation: it is
    worth more trials than there are pairs; Wilson's interval of as many holds for few pairs, too.

    Args:
        pairs: n verdicts in the first and the second world from the same starts.
        rest: N trials in the first world from other starts of the same distribution.

    Returns:
        The estimate, with the number of trials in the second world that it is worth.
    """
    cells = np.array([pairs.both, pairs.first, pairs.second, pairs.neither], np.float64)
    count = float(cells.sum())
    if not count or not rest.trials:
        return Rate(cells[[0, 2]].sum(), count)
    both, only_first, only_second, _ = (cells + SMOOTHING) / (count + 4 * SMOOTHING)
    here, there = both + only_first, both + only_second
    shared, spread = both - here * there, here * (1.0 - here)
    more = rest.trials / (rest.trials + count)
    found = cells[[0, 2]].sum() / count + shared / spread * more * (rest.value - cells[:2].sum() / count)
    worth = count / (1.0 - shared**2 / (spread * there * (1.0 - there)) * more)
    return Rate(float(np.clip(found, 0.0, 1.0) * worth), float(worth))


def _apart(one: float, other: float, alike: float) -> float:
    """Length of the difference of two errors with this correlation."""
    return math.sqrt(max(0.0, one * one - 2.0 * alike * one * other + other * other))


def _log_evidence(total: float, trials: int, rate: float) -> float:
    rest = trials - total
    mixed = math.lgamma(total + 1.0) + math.lgamma(rest + 1.0) - math.lgamma(trials + 2.0)
    return mixed - total * math.log(rate) - rest * math.log1p(-rate)


def _quantile(confidence: float) -> float:
    return NormalDist().inv_cdf(0.5 + confidence / 2)
