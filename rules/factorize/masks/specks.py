"""Small regions that are parts of the support or noise: the edge of a table, a shadow, the foot of furniture."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.objects.view import Seen

from ..overlap import inwards
from ..regions.heights import least_height
from ..regions.proposals import colour_lab
from ..regions.relations import histogram

SMALL_M2 = 0.0015
"""Regions with a larger seen surface are objects [m^2]."""
THIN_M = 0.01
"""Half width below which a region is a strip, and as doubtful as a small one [m]."""
LOW_M = 0.025
"""Height above the support up to which a region with its colours is a part of it [m]."""
ALIKE = 0.5
"""Smallest histogram overlap of colours of one surface, with and without shadow."""
NOISES = 2.0
"""Least height of a small object, relative to that which noise reaches."""
FEWEST = 50
"""Minimum number of pixels of the support beside a region."""


def why_speck(seen: Seen) -> str:
    """Why a region is no object of its own; empty if it is one.

    Args:
        seen: The region, in a crop with a margin.
    """
    from scipy import ndimage

    depth = seen.depth.astype(np.float64)
    own = seen.mask & (depth > 0)
    side = depth / float(np.sqrt(seen.k[0, 0] * seen.k[1, 1]))
    inside = float(inwards(seen.mask).max()) * float(np.median(side[own]))
    if float(np.square(side[own]).sum()) > SMALL_M2 and inside > THIN_M:
        return ""
    height = seen.world_points()[..., 2]
    top = float(np.quantile(height[own], 0.95))
    noise = float(np.median(least_height(depth[own])))
    if top < NOISES * noise:
        return f"it is small, and its height of {1000 * top:.0f} mm may be noise"
    if top > LOW_M:
        return ""
    around = ndimage.binary_dilation(seen.mask, iterations=3) | ndimage.binary_dilation(seen.occluder, iterations=3)
    beside = (depth > 0) & ~around & (np.abs(height) < least_height(depth))
    if beside.sum() < FEWEST:
        return ""
    lab = colour_lab(seen.rgb)
    alike = float(np.minimum(histogram(lab[seen.mask]), histogram(lab[beside])).sum())
    return f"it is small, {1000 * top:.0f} mm high, and has the colours of the support" if alike > ALIKE else ""
