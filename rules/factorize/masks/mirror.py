"""Symmetry lines and convex outlines of partly occluded masks."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import regions

Line = tuple[float, float, float]
"""Unit normal (down, right) and offset [px]: a pixel (row, column) is on it if row * down + column * right = offset."""


def convex(mask: np.ndarray) -> np.ndarray:
    """The pixels (H, W) bool inside the convex outline of a mask."""
    outline = regions.convex_hull(np.argwhere(mask).astype(np.float64))
    if len(outline) < 3:
        return mask
    return np.asarray(regions.inside_convex(np.moveaxis(np.indices(mask.shape, dtype=np.float64), 0, -1), outline))


def mirrored(shape: tuple[int, ...], line: Line) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mirror image of each pixel: rows, columns (H, W) int, and whether it is inside the picture."""
    rows, columns = np.indices(shape)
    down, right, offset = line
    distance = 2.0 * (rows * down + columns * right - offset)
    there, across = np.round(rows - distance * down).astype(int), np.round(columns - distance * right).astype(int)
    inside = (there >= 0) & (across >= 0) & (there < shape[0]) & (across < shape[1])
    return np.clip(there, 0, shape[0] - 1), np.clip(across, 0, shape[1] - 1), inside


def best_line(
    mask: np.ndarray, hidden: np.ndarray, angles: int, astray: float, shared: float, longest_px: int
) -> Line | None:
    """The line about which the visible mask is most symmetric, or None.

    Args:
        mask: (H, W) bool, visible pixels.
        hidden: (H, W) bool, occluded pixels that may be the object's.
        angles: Number of directions.
        astray: Largest fraction of the mirrored mask that may be neither on `mask` nor on `hidden`.
        shared: Smallest fraction of the mirrored mask that must be on `mask`.
        longest_px: Longest side of the reduced picture in which lines are tried [px].
    """
    step = max(1, -(-max(mask.shape) // longest_px))
    own, free = mask[::step, ::step], hidden[::step, ::step]
    points = np.argwhere(own)
    if len(points) < 20:
        return None
    best, least = None, np.inf
    for angle in np.arange(angles) * np.pi / angles:
        normal = np.array([np.sin(angle), np.cos(angle)])
        along = points @ normal
        low, high = float(along.min()), float(along.max())
        # A line must cross the visible part away from its edge: nothing farther is observed.
        for offset in np.arange(low + 0.3 * (high - low), low + 0.7 * (high - low) + 0.5, 1.0):
            away, common = _judge(own, free, points, normal, float(offset))
            cost = away + 0.2 * (1.0 - common)
            if away <= astray and common >= shared and cost < least:
                best, least = (float(normal[0]), float(normal[1]), float(offset) * step), cost
    return best


def _judge(
    own: np.ndarray, free: np.ndarray, points: np.ndarray, normal: np.ndarray, offset: float
) -> tuple[float, float]:
    """Fractions of the mirrored points (n, 2) that are on neither mask, and that are on the object's own."""
    image = np.round(points - 2.0 * (points @ normal - offset)[:, None] * normal).astype(int)
    inside = (image >= 0).all(axis=1) & (image[:, 0] < own.shape[0]) & (image[:, 1] < own.shape[1])
    rows, columns = image[inside].T
    on_own, on_free = own[rows, columns].sum(), (free & ~own)[rows, columns].sum()
    return 1.0 - float(on_own + on_free) / len(points), float(on_own) / len(points)
