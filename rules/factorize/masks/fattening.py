"""Foreground fattening: a stereo camera gives support beside an object the object's depth, where it has no texture.

Depth then ends where the photograph has no edge, and the edge of the photograph is inside the mask.
"""

from __future__ import annotations

import numpy as np

from ..overlap import crop, inwards
from ..regions import proposals
from ..regions.heights import Relief
from . import colours

AROUND_PX = 40
"""Distance from a mask within which the support's colours are taken [px]."""
CORE = 0.5
"""Pixels with this fraction of the largest distance from the border show the object's colours."""
ALIKE = 0.6
"""Maximum distance of a colour from the support's, as a fraction of its distance from the object's."""
EDGE_PX = 5
"""Width of the window in which an edge of the photograph may lie [px]."""
WEAK, NO_EDGE = 2.5, 1.5
"""Maximum edge at the outer border of fattened depth, as a multiple of the support's own texture and as a gradient [CIE
Lab per px]. On real table tops and labelled clutter, the borders of objects had 4 times the texture or more."""
STRONG = 0.55
"""Maximum edge at the outer border, as a fraction of the edge at the inner one."""
OPEN = 0.65
"""Least length of the outer border, as a fraction of the inner one; print that resembles the support has less."""
LEAST_PX = 40
"""Smaller parts are left to the border's refinement [px]."""


def thinned(mask: np.ndarray, others: np.ndarray, relief: Relief, pixels: np.ndarray) -> np.ndarray:
    """The mask (H, W) bool without parts that look like the support and that an edge parts from the object alone.

    Args:
        mask: (H, W) bool, measured pixels of the object.
        others: (H, W) bool, pixels of other objects.
        relief: Heights of the capture.
        pixels: (H, W, 3) uint8 photograph.
    """
    from scipy import ndimage

    box = crop(mask, AROUND_PX)
    own, foreign = mask[box], others[box]
    support = relief.valid[box] & ~relief.raised[box] & ~foreign
    lab = ndimage.median_filter(proposals.colour_lab(pixels[box]), size=(3, 3, 1))
    support &= ~ndimage.binary_dilation(own, iterations=EDGE_PX)
    core, like = _like(support, own, lab)
    labels, count = ndimage.label(ndimage.binary_opening(like & own, np.ones((3, 3), bool)))
    edges = _edges(lab)
    # Where the support itself ends, the photograph has an edge in any case.
    beside = ~own & ~foreign & ~ndimage.binary_dilation(~like & ~own, iterations=EDGE_PX // 2 + 1)
    fat = np.zeros_like(own)
    for number in np.flatnonzero(np.bincount(labels.ravel(), minlength=count + 1)[1:] >= LEAST_PX) + 1:
        part = labels == number
        ring = ndimage.binary_dilation(part) & ~part
        outer, inner = ring & beside, ring & own
        if inner.any() and outer.sum() > OPEN * inner.sum():
            edge = np.median(edges[outer])
            if edge < STRONG * np.median(edges[inner]) and edge < max(NO_EDGE, WEAK * np.median(edges[support])):
                fat |= (part | ring) & own & like
    found = mask.copy()
    found[box] = _with_core(own & ~fat, core, ndimage.binary_dilation(fat, iterations=EDGE_PX))
    return found


def _with_core(left: np.ndarray, core: np.ndarray, removed: np.ndarray) -> np.ndarray:
    """`left` (h, w) bool without islands that a removed part had joined to the rest."""
    from scipy import ndimage

    labels, count = ndimage.label(left)
    numbers = np.arange(count + 1)
    kept = ndimage.maximum(core, labels, numbers) | ~ndimage.maximum(removed, labels, numbers).astype(bool)
    return np.asarray(left & np.asarray(kept, bool)[labels])


def _like(support: np.ndarray, own: np.ndarray, lab: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The core of an object, and pixels with colours of the support and not of that core, (h, w) bool each."""
    from scipy import ndimage

    # Fattened depth is much wider than the pixels at a border that mix two colours, as `matte.core` leaves them out.
    inside = inwards(own)
    core = inside > CORE * inside.max()
    known = (core, support)
    if not all(where.any() for where in known):
        return core, np.zeros_like(own)
    near = ndimage.binary_dilation(own, iterations=EDGE_PX)
    to_core, to_support = (colours.distances(lab, near, where) for where in known)
    like = np.zeros_like(own)
    like[near] = to_support < ALIKE * to_core
    return core, like


def _edges(lab: np.ndarray) -> np.ndarray:
    """Largest colour gradient (h, w) within EDGE_PX [CIE Lab per px]."""
    from scipy import ndimage

    smooth = ndimage.gaussian_filter(lab, (1.0, 1.0, 0.0))
    steps = [ndimage.sobel(smooth, axis=axis) / 8.0 for axis in (0, 1)]
    return np.asarray(ndimage.maximum_filter(np.sqrt(sum((step**2).sum(axis=-1) for step in steps)), EDGE_PX))
