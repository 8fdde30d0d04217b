"""Things on the support to the left and right of the depth image, which is often narrower than the photograph.

No body is made of what has no depth, so a warning names it.
"""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import regions
from dextera_build.geometry.regions import box_of

from ..measured import Workspace
from ..overlap import Box
from ..regions.heights import BEYOND_M
from . import colours
from .clear import AROUND_PX, LARGEST_M, UNLIKE_LAB, Surface, is_thick, surface_of

LEAST = 0.05
"""Smallest fraction of a column that is measured in the depth image."""
LEAST_M2 = 0.003
"""Smallest area of a thing, where it hides the support [m^2]."""
EDGE_PX = 12
"""Columns at the border of the depth image in which the support is looked for [px]."""
FOOT_PX = (4, 24)
"""How far above the lowest pixel of a thing the support must be in view beside it [px]."""


def things_beside_depth(seen: Workspace) -> list[Box]:
    """Boxes (left, top, right, bottom) [px] of things beside the depth image, from the left.

    Args:
        seen: The photograph with its depth; none are found in one that is not upright.
    """
    columns = np.flatnonzero((seen.depth > 0).mean(axis=0) > LEAST)
    if seen.turns or not len(columns) or (columns[0], columns[-1]) == (0, seen.camera.width - 1):
        return []
    near, expected = seen.over_support(BEYOND_M)
    area = np.square(expected) / (seen.camera.fx * seen.camera.fy)
    surface, first, last = surface_of(seen), int(columns[0]), int(columns[-1])
    found = []
    for side, border in (
        (np.s_[:, :first], np.s_[first : first + EDGE_PX]),
        (np.s_[:, last + 1 :], np.s_[last - EDGE_PX : last]),
    ):
        beside = np.zeros_like(near)
        beside[side] = near[side]
        found += [box_of(mask) for mask in _things(surface, beside, area, border)]
    return found


def _things(surface: Surface, beside: np.ndarray, area: np.ndarray, border: slice) -> list[np.ndarray]:
    """Masks (H, W) of the things at pixels `beside` (H, W); `border` are the columns of the depth image beside it."""
    from scipy import ndimage

    unlike = ndimage.binary_opening(_unlike(surface, beside), np.ones((3, 3), bool))
    labels, count = regions.label(ndimage.binary_closing(np.pad(unlike, 6), np.ones((5, 5), bool))[6:-6, 6:-6])
    found = []
    for number in range(1, count + 1):
        mask = labels == number
        _, top, _, bottom = box_of(mask)
        extent = (bottom - top) * float(np.sqrt(np.median(area[mask])))
        foot = surface.bare[max(0, bottom - FOOT_PX[1]) : max(1, bottom - FOOT_PX[0]), border]
        large = float(area[mask].sum()) > LEAST_M2 and is_thick(mask, area)
        # What goes on above the far edge of the support may be floor or wall behind it.
        above = surface.bare[:top, border].any()
        if large and above and extent < LARGEST_M and foot.mean() > 0.5:
            found.append(mask)
    return found


def _unlike(surface: Surface, mask: np.ndarray) -> np.ndarray:
    """Pixels (H, W) of a mask whose colour the support beside them lacks."""
    from scipy import ndimage

    beside = surface.bare & (ndimage.distance_transform_edt(~mask) < AROUND_PX if mask.any() else mask)
    found = np.zeros_like(mask)
    if beside.any():
        found[mask] = colours.distances(surface.lab, mask, beside, 2 * colours.SAMPLES) > UNLIKE_LAB
    return found
