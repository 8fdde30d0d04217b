"""Colour model that separates an object from its surroundings."""

from __future__ import annotations

import numpy as np

_BITS = 4
"""Bits per channel of a histogram."""
_EMPTY = 0.3
"""Pseudo-count of each colour, which keeps unseen colours undecided."""


def bins(pixels: np.ndarray) -> np.ndarray:
    """Histogram bin (...) of colours (..., 3) uint8."""
    high = (pixels >> (8 - _BITS)).astype(np.int32)
    return np.asarray((high[..., 0] << 2 * _BITS) | (high[..., 1] << _BITS) | high[..., 2])


class Colours:
    """Histograms of the object and its surroundings, learned from frames in which it is tracked."""

    def __init__(self) -> None:
        self._inside = np.zeros(1 << 3 * _BITS)
        self._around = np.zeros(1 << 3 * _BITS)
        self._odds: np.ndarray | None = None

    @property
    def known(self) -> bool:
        """Whether a histogram has been learned."""
        return bool(self._inside.any())

    def learn(self, inside: np.ndarray, around: np.ndarray, rate: float) -> None:
        """Update with the bins (N,) of the object's pixels and (M,) of its surroundings, with weight `rate`."""
        for held, found in ((self._inside, inside), (self._around, around)):
            if len(found) < 20:
                continue
            fresh = np.bincount(found, minlength=len(held)) / len(found)
            held *= 1.0 - rate
            held += rate * fresh
        self._odds = None

    def odds(self) -> np.ndarray:
        """Log-likelihood ratio of object against surroundings per bin, within +-3."""
        if self._odds is None:
            even = _EMPTY / 400.0
            self._odds = np.clip(np.log((self._inside + even) / (self._around + even)), -3.0, 3.0)
        return self._odds
