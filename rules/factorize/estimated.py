"""Combination of an estimate by a vision-language model with what tables say about a thing.

An estimate is evidence with a chance to be wrong: its likelihood is a normal distribution about the middle of its
interval, or, with probability 1 - `TRUST`, the same everywhere. An estimate that agrees with the tables therefore
narrows their interval, and one that contradicts them changes little.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dextera_build.statistics import Z90

TRUST = 0.8
"""Probability that an estimate is about this thing; an assumption, as are the next two."""
LEAST_LOG = 0.3
"""Smallest standard deviation of the logarithm of an estimated mass: models state narrow intervals."""
LEAST = 0.05
"""Smallest standard deviation of an estimated coefficient."""
LOG_KG = np.linspace(math.log(1e-4), math.log(100.0), 2000)
"""Logarithms of the masses at which distributions are evaluated [kg]."""
Interval = tuple[float, float]
"""The 5 % and the 95 % quantile."""
Quantiles = tuple[float, float, float]
"""The 5 %, 50 % and 95 % quantile."""


def of_mixture(shares: np.ndarray, known: Sequence[Quantiles], estimate: Interval | None = None) -> Quantiles:
    """Quantiles [kg] of a mixture of log-normal distributions, each with a standard deviation on either side.

    Args:
        shares: (N,) their probabilities.
        known: Their quantiles [kg].
        estimate: Interval of a mass that a model estimated [kg]; None: none.
    """
    from scipy.special import ndtr

    logs = np.log(np.asarray(known))
    steps = LOG_KG[:, None] - logs[:, 1]
    below, above = (np.maximum(np.abs(logs[:, side] - logs[:, 1]) / Z90, 1e-3) for side in (0, 2))
    reached = ndtr(steps / np.where(steps < 0.0, below, above)) @ shares
    if estimate is not None:
        low, high = (math.log(end) for end in estimate)
        likelihood = _likelihood(LOG_KG, (low, high), LEAST_LOG)
        reached = np.cumsum(np.gradient(reached) * likelihood)
        reached /= reached[-1]
    low, middle, high = np.exp(np.interp([0.05, 0.5, 0.95], reached, LOG_KG)).tolist()
    return low, middle, high


def coefficient(mean: float, sigma: float, estimate: Interval, most: float) -> tuple[float, float]:
    """Mean and standard deviation of a coefficient between 0 and `most`.

    Args:
        mean: That of the material table.
        sigma: Its standard deviation.
        estimate: Interval that a model estimated.
        most: Largest possible value.
    """
    grid = np.linspace(0.0, most, 2001)
    chances = np.exp(-0.5 * ((grid - mean) / sigma) ** 2) * _likelihood(grid, estimate, LEAST)
    chances /= chances.sum()
    middle = float(chances @ grid)
    return middle, math.sqrt(float(chances @ (grid - middle) ** 2))


def _likelihood(grid: np.ndarray, estimate: Interval, least: float) -> np.ndarray:
    """Density of an estimate if the truth is at each point (N,) of an even grid."""
    sigma = max((estimate[1] - estimate[0]) / (2.0 * Z90), least)
    z = (grid - 0.5 * (estimate[0] + estimate[1])) / sigma
    about = np.exp(-0.5 * z * z) / (sigma * math.sqrt(2.0 * math.pi))
    return np.asarray(TRUST * about + (1.0 - TRUST) / (grid[-1] - grid[0]))
