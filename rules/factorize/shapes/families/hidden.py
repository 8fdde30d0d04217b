"""Cells of a footprint that something in front hides: as the mirror image of what is seen, and between seen parts."""

from __future__ import annotations

import numpy as np

ALIKE = 0.85
"""Smallest overlap of the seen cells with their mirror image, where both are in view."""
LEAST_SHARED = 0.4
"""Smallest fraction of the seen cells whose mirror image is in view; fewer tell nothing of a symmetry."""
TURNS_DEG = tuple(range(-16, 17, 4))
"""Directions of the axis that are tried, from that of the longest extent."""
SHIFTS = (-0.2, -0.15, -0.1, -0.05, 0.0, 0.05, 0.1, 0.15, 0.2)
"""Places of the axis that are tried: distance from the centre over the width of the seen cells."""
FINER = (1, 3, 9)
"""Factors by which the searches of the axis are finer, each about the best one of that before."""
GAPS = (2, 4, 8, 16, 32)
"""Half widths of hidden gaps between seen parts that are closed, in cells; the first that leaves one part is taken."""


def completed(seen: np.ndarray, hidden: np.ndarray) -> np.ndarray:
    """The footprint (H, W) bool with what is likely in its hidden cells.

    Args:
        seen: Cells (H, W) bool in view that belong to the body.
        hidden: Cells (H, W) bool that may belong to it.
    """
    if not (hidden & ~seen).any() or not seen.any():
        return seen
    return _joined(seen | (_mirrored(seen, hidden) & hidden), hidden)


def _mirrored(seen: np.ndarray, hidden: np.ndarray) -> np.ndarray:
    """The mirror image of the seen cells about the best axis; empty if they are not symmetric about any."""
    places = np.argwhere(seen).astype(np.float64)
    centre = places.mean(axis=0)
    spread, axes = np.linalg.eigh(np.cov((places - centre).T) + 1e-9 * np.eye(2))
    middle, width = 0.0, 2.0 * np.sqrt(3.0 * spread[0])
    best, along = (-1.0, np.zeros_like(seen)), float(np.arctan2(axes[1, 1], axes[0, 1]))
    turn = 0.0
    for finer in FINER:
        around = (turn, middle)
        for more in np.deg2rad(TURNS_DEG) / finer:
            for shift in np.array(SHIFTS) * width / finer:
                here = (around[0] + more, around[1] + shift)
                image = _reflected(seen, hidden, centre, along + here[0], here[1])
                if image[0] > best[0]:
                    best, (turn, middle) = image, here
    return best[1] if best[0] > ALIKE else np.zeros_like(seen)


def _reflected(
    seen: np.ndarray, hidden: np.ndarray, centre: np.ndarray, angle: float, shift: float
) -> tuple[float, np.ndarray]:
    """Overlap of seen cells with their mirror image about an axis at `angle`, `shift` cells off `centre`; the image."""
    from scipy import ndimage

    normal = np.array([-np.sin(angle), np.cos(angle)])
    turn = np.eye(2) - 2.0 * np.outer(normal, normal)
    offset = centre + shift * normal
    offset = offset - turn @ offset
    image, unseen = (
        ndimage.affine_transform(cells.astype(np.uint8), turn, offset, order=0, cval=fill) > 0
        for cells, fill in ((seen, 0), (hidden & ~seen, 1))
    )
    compared = ~unseen & (seen | ~hidden)
    shared = np.count_nonzero(seen & compared)
    if shared < LEAST_SHARED * np.count_nonzero(seen):
        return -1.0, image
    return np.count_nonzero(seen & image & compared) / np.count_nonzero((seen | image) & compared), image


def _joined(seen: np.ndarray, hidden: np.ndarray) -> np.ndarray:
    """The cells with hidden gaps between their parts closed."""
    from scipy import ndimage

    if ndimage.label(seen)[1] < 2:
        return seen
    for gap in GAPS:
        padded = np.pad(seen, gap)
        closed = ndimage.binary_closing(padded, np.ones((3, 3), bool), iterations=gap)[gap:-gap, gap:-gap]
        made = seen | (closed & hidden)
        if ndimage.label(made)[1] < 2:
            return np.asarray(made)
    return seen
