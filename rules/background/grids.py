"""Divide the filled cells of a grid into boxes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np


def rectangles(grid: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Boxes of filled cells, first and last corner in cells, that together cover a grid (bool, any dimension) once."""
    left = grid.copy()
    while left.any():
        low = np.array(np.unravel_index(int(np.argmax(left)), left.shape))
        high = low + 1
        for axis in reversed(range(left.ndim)):
            while high[axis] < left.shape[axis] and _layer(left, low, high, axis).all():
                high[axis] += 1
        left[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = False
        yield low, high


def _layer(grid: np.ndarray, low: np.ndarray, high: np.ndarray, axis: int) -> np.ndarray:
    """The cells that a box would gain by one more layer along an axis."""
    area = [slice(a, b) for a, b in zip(low, high, strict=True)]
    area[axis] = slice(high[axis], high[axis] + 1)
    return np.asarray(grid[tuple(area)])
