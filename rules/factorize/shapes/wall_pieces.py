"""Exact convex pieces of a vessel: slabs around the ring and a floor keep the cavity open."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

SECTORS = 20
"""Number of slabs around the ring; their inner faces are chords and fill 1.6 % of a round cavity."""
BULGE_M = 0.0008
"""A slab is split in height if its inner face would bulge further than this into the cavity, square to it [m]."""


def ring_walls(outer: np.ndarray, inner: np.ndarray) -> tuple[np.ndarray, ...]:
    """Corner points (V, 3) of convex pieces.

    Args:
        outer: (K, M, 3) rings of the outside from the base up, M a multiple of `SECTORS`.
        inner: (L, M, 3) rings of the cavity from the rim down to the floor.
    """
    floor = float(inner[-1, 0, 2])
    level = np.concatenate([_at(outer, floor)[None], outer[outer[:, 0, 2] > floor + 1e-6]])
    cavity = inner[::-1]
    cuts = _cuts(np.linalg.norm(cavity[:, 0, :2], axis=1), cavity[:, 0, 2])
    pieces = [np.concatenate([outer[outer[:, 0, 2] < floor - 1e-6].reshape(-1, 3), level[0]])]
    size = outer.shape[1] // SECTORS
    for low, high in pairwise(cuts):
        bottom, top = cavity[low, 0, 2], cavity[high, 0, 2]
        between = (level[:, 0, 2] > bottom + 1e-6) & (level[:, 0, 2] < top - 1e-6)
        skin = np.concatenate([_at(level, bottom)[None], level[between], _at(level, top)[None]])
        lining = cavity[low : high + 1]
        for sector in range(SECTORS):
            columns = np.arange(sector * size, (sector + 1) * size + 1) % outer.shape[1]
            pieces.append(np.concatenate([skin[:, columns], lining[:, columns]]).reshape(-1, 3))
    return tuple(pieces)


def _at(rings: np.ndarray, height: float) -> np.ndarray:
    """The ring (M, 3) at a height, interpolated between `rings`."""
    heights = rings[:, 0, 2]
    above = int(np.clip(np.searchsorted(heights, height), 1, len(heights) - 1))
    low, high = heights[above - 1], heights[above]
    part = float(np.clip((height - low) / max(high - low, 1e-9), 0.0, 1.0))
    return np.asarray(rings[above - 1] * (1.0 - part) + rings[above] * part)


def _cuts(radii: np.ndarray, heights: np.ndarray) -> list[int]:
    """Indices of heights between which the chord stays within `BULGE_M` of the cavity's profile."""
    cuts = [0]
    while cuts[-1] < len(radii) - 1:
        start, end = cuts[-1], len(radii) - 1
        while end > start + 1:
            rise, run = heights[end] - heights[start], radii[end] - radii[start]
            outwards = (radii[start : end + 1] - radii[start]) * rise - (
                heights[start : end + 1] - heights[start]
            ) * run
            if outwards.max() <= BULGE_M * np.hypot(rise, run):
                break
            end -= 1
        cuts.append(end)
    return cuts
