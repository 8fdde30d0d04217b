"""Delays of a session: how long messages took, as percentiles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

KEPT = 20_000
"""The newest this many are kept."""


class Delays:
    """Delays of one kind [ms]."""

    def __init__(self) -> None:
        self._values: list[float] = []

    def add(self, values_ms: Sequence[float]) -> None:
        """Take note of some."""
        self._values += values_ms
        del self._values[:-KEPT]

    def __len__(self) -> int:
        return len(self._values)

    def percentiles(self) -> tuple[float, float]:
        """Half, and 99 of 100, are not above these [ms]; NaN if there are none."""
        if not self._values:
            return float("nan"), float("nan")
        middle, late = np.percentile(self._values, [50, 99]).tolist()
        return middle, late

    def told(self) -> str:
        """Both percentiles in words."""
        middle, late = self.percentiles()
        return f"p50 {middle:.1f} ms, p99 {late:.1f} ms of {len(self):,}" if len(self) else "none"
