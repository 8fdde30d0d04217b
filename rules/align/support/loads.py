"""What stands on the flat surfaces of a depth image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dextera_build.geometry import planes, regions

from .surfaces import GATE, Surface

LOWEST_M, HIGHEST_M = 0.012, 0.5
"""Range of heights of what stands on a support [m]."""
FOOT_M = 0.03
"""What stands on a surface is seen from at most this height above it [m]."""
LARGEST_M = 0.6
"""Larger things are furniture [m]."""
MAIN = 0.2
"""A surface with fewer pixels than this, relative to the largest one, may be the face of a thing."""
PARALLEL = np.cos(np.radians(10.0))
"""Cosine of the angle up to which two surfaces are parallel."""
THIN = 2
"""Every how many rows and columns are looked at."""


def loaded(found: list[Surface], points: np.ndarray, valid: np.ndarray) -> list[Surface]:
    """The surfaces with the pixels of what stands on each, relative to its own.

    A thing is a connected region above the surface's outline that is no part of another large surface, reaches
    down to it, and is not larger than furniture. What stands on a surface above another one counts for
    the upper one.

    Args:
        found: All flat surfaces.
        points: (H, W, 3) camera frame [m].
        valid: (H, W) bool, measured pixels.
    """
    coarse, seen = points[::THIN, ::THIN], valid[::THIN, ::THIN]
    sigma = GATE * planes.depth_sigma(coarse[..., 2])
    own = np.zeros(seen.shape, bool)
    most = max((int(surface.region.sum()) for surface in found), default=0)
    for surface in found:
        # Faces of cartons are flat, too.
        if float(np.ptp(surface.outline, axis=0).max()) > LARGEST_M and surface.region.sum() > MAIN * most:
            own |= surface.region[::THIN, ::THIN]
    above = [seen & ~own & _above(surface, coarse, sigma) for surface in found]
    result = []
    for number, surface in enumerate(found):
        mine = above[number].copy()
        for other, higher in zip(found, above, strict=True):
            parallel = float(other.plane[0] @ surface.plane[0]) > PARALLEL
            if other is not surface and parallel and other.plane[1] < surface.plane[1] - FOOT_M:
                mine &= ~higher
        count = _standing(mine, planes.distance(surface.plane, coarse), coarse, sigma)
        result.append(replace(surface, carried=count / max(1, int(surface.region[::THIN, ::THIN].sum()))))
    return result


def _above(surface: Surface, points: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    height = planes.distance(surface.plane, points)
    high = (height > LOWEST_M + sigma) & (height < HIGHEST_M)
    return np.asarray(high & regions.inside_convex(points @ surface.axes[:2].T, surface.outline))


def _standing(above: np.ndarray, height: np.ndarray, points: np.ndarray, sigma: np.ndarray) -> int:
    """Pixels of the things among `above` (h, w) that reach down to the surface."""
    labels, count = regions.label(above)
    total = 0
    for number in range(1, count + 1):
        thing = labels == number
        low = float(np.quantile(height[thing] - sigma[thing], 0.02))
        extent = np.ptp(np.quantile(points[thing], (0.02, 0.98), axis=0), axis=0)
        if low < FOOT_M and float(extent.max()) < LARGEST_M:
            total += int(thing.sum())
    return total
