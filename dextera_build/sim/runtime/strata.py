"""Stratified random numbers over a series of episodes: a Latin hypercube, one episode at a time.

The range of every quantity is divided into as many equal parts as the series has episodes, and every episode gets a
different part of each, in a random order per quantity. Episode k can be drawn without the others.
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist
from typing import Protocol

import numpy as np


class Draws(Protocol):
    """Subset of `np.random.Generator` that starts use."""

    def uniform(self, low: float, high: float, size: int | None = None) -> np.ndarray | float:
        """Uniform numbers."""

    def standard_normal(self) -> float:
        """A normal number."""


@dataclass(frozen=True)
class Stratum:
    """One episode of a series."""

    series: int
    """Seed of the series."""
    index: int
    """Number of the episode, from 0."""
    count: int
    """Episodes of the series."""

    def __post_init__(self) -> None:
        if not 0 <= self.index < self.count:
            raise ValueError(f"episode {self.index} is not one of a series of {self.count}")


class Strata:
    """Random numbers of one episode; the n-th call is always for the same quantity.

    Args:
        stratum: The episode.
        random: Source of positions within the parts.
    """

    def __init__(self, stratum: Stratum, random: np.random.Generator) -> None:
        self._stratum, self._random = stratum, random
        self.asked = 0
        """Number of quantities drawn so far; reset it to draw them again, in the same parts."""

    def uniform(self, low: float, high: float, size: int | None = None) -> np.ndarray | float:
        """Uniform numbers from `low` to `high`."""
        if size is None:
            return low + (high - low) * self._share()
        return low + (high - low) * np.array([self._share() for _ in range(size)])

    def standard_normal(self) -> float:
        """A normal number."""
        return NormalDist().inv_cdf(min(max(self._share(), 1e-12), 1.0 - 1e-12))

    def _share(self) -> float:
        here = self._stratum
        order = np.random.default_rng([here.series, self.asked]).permutation(here.count)
        self.asked += 1
        return float((order[here.index] + self._random.uniform()) / here.count)
