"""Division of a region between points: each pixel goes to the point that is nearest along the surface.

Steps in depth, concave creases and borders of colours make the way longer; convex creases do not, because most objects
have some.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..measured import Workspace
from . import patches
from .heights import relief
from .patches import Surfaces
from .proposals import colour_lab

WALL = 60.0
"""Length of the way through one pixel of a full crease, step or border of colours, over that of a smooth one."""
FAINT = 0.35
"""Weaker creases, steps and borders of colours are noise."""
COLOUR = 30.0
"""Difference of colours that is a full border, in CIE L*a*b* with `LIGHTNESS` of the L*."""
LIGHTNESS = 0.3
"""Weight of L*, which differs between the faces of one object, too."""


def divided(seen: Workspace, region: np.ndarray, points: Sequence[Sequence[tuple[int, int]]]) -> np.ndarray:
    """The part of each pixel, (H, W) int32: 1 for the first entry of `points`, ...; 0 outside the region.

    Args:
        seen: The capture.
        region: (H, W) bool, a region above the support.
        points: Of each part, columns and rows of pixels that belong to it [px].
    """
    s = patches.surfaces(relief(seen), region, seen, colour_lab(seen.pixels))
    parts = np.array([part for part, own in enumerate(points, start=1) for _ in own], np.int32)
    at = np.array([point for own in points for point in own])
    at = (at - [s.left, s.top]) // s.stride
    labels = patches.spread(_nearest(s, at, parts), s.raised, np.inf)
    return patches.spread(s.full(labels, region), region, np.inf)


def _nearest(s: Surfaces, at: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """The part (h, w) int32 of the block that is nearest along the surface; 0 for blocks that none reaches.

    Args:
        s: The blocks of the region.
        at: Column and row (n, 2) of blocks, perhaps beside the region.
        parts: (n,) the part of each.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    rows, columns = np.nonzero(s.raised)
    number = np.full(s.raised.shape, -1)
    number[rows, columns] = np.arange(len(rows))
    cost = 1.0 + WALL * _walls(s)
    height, width = s.raised.shape
    starts, ends, lengths = [], [], []
    for down, right in patches.NEIGHBOURS:
        r, c = rows + down, columns + right
        inside = (r < height) & (c >= 0) & (c < width)
        r0, c0, r, c = (x[inside] for x in (rows, columns, r, c))
        both = number[r, c] >= 0
        r0, c0, r, c = (x[both] for x in (r0, c0, r, c))
        starts.append(number[r0, c0])
        ends.append(number[r, c])
        lengths.append(np.hypot(down, right) * (cost[r0, c0] + cost[r, c]) / 2.0)
    where = (np.concatenate(starts), np.concatenate(ends))
    graph: Any = coo_array((np.concatenate(lengths), where), shape=(len(rows), len(rows))).tocsr()
    seeds = np.square(columns - at[:, :1]) + np.square(rows - at[:, 1:])
    chosen = seeds.argmin(axis=1)
    found: Any = dijkstra(graph, directed=False, indices=chosen, return_predecessors=True, min_only=True)
    sources = found[2]
    owner = np.zeros(len(rows), np.int32)
    owner[chosen[::-1]] = parts[::-1]
    labels = np.zeros(s.raised.shape, np.int32)
    labels[rows, columns] = np.where(sources >= 0, owner[np.maximum(sources, 0)], 0)
    return labels


def _walls(s: Surfaces) -> np.ndarray:
    """Strength (h, w) of the creases, steps and borders of colours at each block, 0 to 1."""
    from scipy import ndimage

    strength = np.zeros(s.inverse.shape)
    lab = s.lab * np.array([LIGHTNESS, 1.0, 1.0])
    for rows, columns, r0, c0, down, right in patches.spans(s):
        angle, step = patches.fold(s, r0, c0, 2 * patches.SPAN * down, 2 * patches.SPAN * right)
        crease = -angle / patches.CREASE_RAD
        r1, c1 = 2 * rows - r0, 2 * columns - c0
        border = np.linalg.norm(lab[r1, c1] - lab[r0, c0], axis=-1) / COLOUR
        value = np.maximum(np.maximum(crease, border), step / patches.step_limit(s, rows, columns))
        strength[rows, columns] = np.maximum(strength[rows, columns], value)
    # A wall is some pixels thick; single strong ones are noise.
    strength = ndimage.median_filter(np.minimum(strength, 1.0), 3)
    return np.where(strength < FAINT, 0.0, strength)
