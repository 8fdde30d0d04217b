"""Observed ends of a surface, as opposed to occlusions and the picture's border."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

BEHIND_M = 0.02
"""A surface continues only where it is at least this far behind the visible one [m]."""
OUTER = 0.1
"""Fraction of a surface's extent, at either side, in which its end is searched."""
LEAST = 0.3
"""Minimum fraction of the pixels at that side of a surface that show its end."""


@dataclass(frozen=True)
class Border:
    """The border of a surface in a picture."""

    away: np.ndarray  # (h, w) distance of each pixel from the surface [px]
    nearest: np.ndarray  # (h, w) int32, which pixel of the surface is nearest
    goes_on: np.ndarray  # (n,) bool by `nearest`, whether the surface is cut there rather than observed to end
    beside: tuple[np.ndarray, np.ndarray]  # rows and columns of the pixels just outside


def border(own: np.ndarray, seen: np.ndarray, depth: np.ndarray) -> Border:
    """The border of a surface.

    An end is observed where a surface is in front of a farther one, or meets another.

    Args:
        own: (h, w) its pixels.
        seen: (h, w) depth of what the picture shows [m]; 0 outside it.
        depth: (h, w) depth of the surface, continued [m]; infinite where it has none.
    """
    away, nearest = cv2.distanceTransformWithLabels(
        (~own).astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
    )
    row, column = np.nonzero((away > 0) & (away < 2.5))
    found = depth[row, column]
    hidden = np.isfinite(found) & (found > seen[row, column] + BEHIND_M)
    votes = np.bincount(nearest[row, column], np.where(hidden, 1.0, -1.0), int(nearest.max()) + 1)
    return Border(away, nearest, votes > 0, (row, column))


def limits(around: Border, own: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest coordinates (2,) of a flat surface, from its observed ends.

    Args:
        around: Its border.
        own: (h, w) its pixels.
        places: (h, w, 2) coordinates in its plane [m]; not finite where it has none.
    """
    low, high = np.full(2, -np.inf), np.full(2, np.inf)
    row, column = around.beside
    if not len(row):
        return low, high
    at = np.zeros((len(around.goes_on), 2))
    at[around.nearest[own]] = places[own]
    number = around.nearest[row, column]
    step = places[row, column] - at[number]
    whole = np.isfinite(step).all(axis=1)
    start, step, ends = at[number][whole], step[whole], ~around.goes_on[number][whole]
    first, last = np.quantile(places[own], [0.005, 0.995], axis=0)
    for axis in (0, 1):
        sideways = np.abs(step[:, axis]) > np.abs(step[:, 1 - axis])
        for bound, sign, edge in ((low, -1, first[axis]), (high, 1, last[axis])):
            near = np.abs(start[:, axis] - edge) < OUTER * (last[axis] - first[axis])
            side = near & sideways & (sign * step[:, axis] > 0)
            if side.any() and ends[side].mean() > LEAST:
                bound[axis] = edge
    return low, high
