"""A low pass of joint positions with its cut-off in Hz, whatever the rate of the messages."""

from __future__ import annotations

import numpy as np

STAGES = 2
"""Equal filters of first order in series: the noise of trackers is weakened by the square."""


class LowPass:
    """The filter of one hand.

    Args:
        cut_off_hz: Frequency at which the power is halved [Hz]; 0: no filter.
    """

    def __init__(self, cut_off_hz: float) -> None:
        self._cut_off = cut_off_hz
        self._kept: list[np.ndarray] | None = None

    def begin(self, values: np.ndarray) -> None:
        """Start at rest at `values`."""
        self._kept = [np.array(values, np.float64) for _ in range(STAGES)]

    def next(self, values: np.ndarray, seconds: float) -> np.ndarray:
        """The filtered `values`, `seconds` after the last ones; the first call returns them as they are."""
        if self._kept is None or not self._cut_off:
            self.begin(values)
            return np.array(values, np.float64)
        share, found = _share(self._cut_off * seconds), np.asarray(values, np.float64)
        for stage in self._kept:
            stage += share * (found - stage)
            found = stage
        return np.array(found)


def _share(cycles: float) -> float:
    """Share of the input in y += share (x - y), such that all stages together halve the power.

    The response of one stage, share^2 / (share^2 + 2 (1 - share) (1 - cos w)) at w radians per sample, is set to the
    root of one half and solved for the share: no approximation for high rates.

    Args:
        cycles: Cut-off frequency times the time between samples; from 1/2 on nothing is filtered.
    """
    if cycles >= 0.5:
        return 1.0
    power = 0.5 ** (1 / STAGES)
    slow = power * (1.0 - np.cos(2 * np.pi * cycles))
    return float((np.sqrt(slow**2 + 2 * slow * (1 - power)) - slow) / (1 - power))
