"""Intervals of means in tables, as options that several rules share."""

from __future__ import annotations

import numpy as np
from pydantic import Field, NonNegativeInt, PositiveInt

from dextera_build.rule import Options
from dextera_build.statistics import bootstrap


class IntervalOptions(Options):
    """A percentile bootstrap of the mean."""

    draws: PositiveInt = 10000
    """Bootstrap samples."""
    confidence: float = Field(0.95, gt=0.0, lt=1.0)
    """Coverage probability of the interval."""
    seed: NonNegativeInt = 0
    """Seed of the bootstrap."""

    def interval(self, values: np.ndarray) -> tuple[float, float] | tuple[None, None]:
        """Lower and upper end of the interval of the mean of (N,) values; None without values."""
        return bootstrap(values, self.draws, self.confidence, self.seed) if len(values) else (None, None)
