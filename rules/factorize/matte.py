"""Pixel-accurate masks: holes and borders where the depth camera saw nothing or could not tell."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import regions

from .heights import Relief

BAND = 8
"""How far beyond the measured mask unmeasured pixels may belong to the object [px]."""
EDGE = 2
"""How far beyond it measured pixels near the support may [px]."""
MOST_GAIN = 0.5
"""A border that grows the mask by more than this part is not believed."""


def complete(mask: np.ndarray, others: np.ndarray, relief: Relief, pixels: np.ndarray) -> np.ndarray:
    """The mask (H, W) bool with its holes filled and its border moved to the object's colours.

    Args:
        mask: (H, W) bool, measured pixels of the object.
        others: (H, W) bool, pixels of other objects; they stay out.
        relief: Heights of the capture.
        pixels: (H, W, 3) uint8 photograph.
    """
    from scipy import ndimage

    smooth = ndimage.binary_closing(np.pad(mask, 4), np.ones((3, 3)))[4:-4, 4:-4] & ~others
    filled = fill(mask | (smooth & ~relief.valid), others, relief)
    grown = border(filled, others, relief, pixels)
    return fill(grown, others, relief)


def fill(mask: np.ndarray, others: np.ndarray, relief: Relief) -> np.ndarray:
    """Holes that lie over the object's footprint, such as the floor of a bowl; what shows through a handle stays out."""
    from scipy import ndimage

    holes = ndimage.binary_fill_holes(mask) & ~mask & ~others
    labels, count = ndimage.label(holes)
    if not count:
        return mask
    outline = regions.convex_hull(relief.points[mask & relief.valid][:, :2])
    within = relief.valid & regions.inside_convex(relief.points[..., :2], outline)
    numbers = np.arange(1, count + 1)
    size = np.asarray(ndimage.sum(holes, labels, numbers))
    measured = np.asarray(ndimage.sum(relief.valid, labels, numbers))
    inside = np.asarray(ndimage.sum(within, labels, numbers))
    small = (measured == 0) & (size < max(30.0, 0.02 * mask.sum()))
    keep = np.concatenate([[False], small | ((measured > 0) & (inside > 0.7 * measured))])
    return np.asarray(mask | keep[labels])


def border(mask: np.ndarray, others: np.ndarray, relief: Relief, pixels: np.ndarray) -> np.ndarray:
    """The mask with those undecided pixels around it that look more like the object than like what surrounds it."""
    import cv2
    from scipy import ndimage

    away = ndimage.distance_transform_edt(~mask)
    low = relief.valid & (np.abs(relief.height) < relief.threshold)
    open_ = ~mask & ~others & (((away <= BAND) & ~relief.valid) | ((away <= EDGE) & low))
    box = _box(mask, 2 * BAND + 8)
    inner = ndimage.binary_erosion(mask, iterations=2)[box]
    if not open_.any() or inner.sum() < 20:
        return mask
    trimap = np.full(mask[box].shape, cv2.GC_BGD, np.uint8)
    trimap[open_[box]] = cv2.GC_PR_BGD
    trimap[mask[box]] = cv2.GC_FGD
    window = np.ascontiguousarray(pixels[box])
    # The colours of other objects must not enter the background model: paint them as unknown background.
    cv2.setRNGSeed(0)
    cv2.grabCut(window, trimap, None, np.zeros((1, 65)), np.zeros((1, 65)), 2, cv2.GC_INIT_WITH_MASK)
    won = np.zeros_like(mask)
    won[box] = (trimap == cv2.GC_PR_FGD) & open_[box]
    won = ndimage.binary_opening(won | mask, np.ones((2, 2))) & won
    labels, _ = ndimage.label(won | mask)
    joined = np.isin(labels, np.unique(labels[mask])) & (won | mask)
    return joined if (joined & ~mask).sum() <= MOST_GAIN * mask.sum() else mask


def _box(mask: np.ndarray, margin: int) -> tuple[slice, slice]:
    rows, columns = np.nonzero(mask)
    return (
        slice(max(0, int(rows.min()) - margin), int(rows.max()) + margin + 1),
        slice(max(0, int(columns.min()) - margin), int(columns.max()) + margin + 1),
    )
