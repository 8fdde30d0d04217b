"""Find surfaces between the camera and an object."""

from __future__ import annotations

import numpy as np

REACH = 48
"""Maximum distance of an occluder from the object [px]."""


def occluders(mask: np.ndarray, raised: np.ndarray, depth: np.ndarray, step_m: float = 0.008) -> np.ndarray:
    """Pixels (h, w) bool of other surfaces nearer than the adjacent object, dilated by 1 px.

    Args:
        mask: (h, w) bool, the object.
        raised: (h, w) bool, pixels above the support.
        depth: (h, w) [m], 0 if not measured.
        step_m: Smallest depth difference of an occluder [m].
    """
    reach = nearest_depth(mask & (depth > 0), depth)
    nearer = raised & ~mask & (depth > 0) & (reach > 0) & (depth < reach - step_m)
    return np.asarray(grown(nearer) & ~mask)


def lower_in_the_picture(labels: np.ndarray, fixed: np.ndarray, number: int) -> np.ndarray:
    """Pixels (H, W) bool of things that reach lower in the picture than object `number`, dilated by 1 px.

    In the view of a camera that looks down on one support, nearer objects touch it lower in the picture. No measurement
    is used.

    Args:
        labels: (H, W) int32 instance labels.
        fixed: (H, W) bool, static elements.
        number: Label of the object.
    """
    mask = labels == number
    lowest = _lowest(mask)
    nearer = np.zeros(labels.shape, bool)
    for other in [*(labels == n for n in np.unique(labels) if n not in (0, number)), fixed]:
        if _lowest(other) > lowest:
            nearer |= other
    return np.asarray(grown(nearer) & ~mask)


def _lowest(mask: np.ndarray) -> int:
    rows = np.flatnonzero(mask.any(axis=1))
    return int(rows[-1]) if len(rows) else -1


def grown(mask: np.ndarray) -> np.ndarray:
    """The mask (H, W) bool with its 4-neighbours."""
    wider = mask.copy()
    wider[1:] |= mask[:-1]
    wider[:-1] |= mask[1:]
    wider[:, 1:] |= mask[:, :-1]
    wider[:, :-1] |= mask[:, 1:]
    return wider


def nearest_depth(mask: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Depth (h, w) [m] of the nearest mask pixel in 4-neighbour steps; 0 out of reach."""
    known = np.where(mask, depth, 0.0)
    for _ in range(REACH):
        open_ = known == 0
        if not open_.any() or not known.any():
            break
        spread = known.copy()
        for axis, shift in ((0, 1), (0, -1), (1, 1), (1, -1)):
            moved = np.roll(known, shift, axis=axis)
            edge = [slice(None), slice(None)]
            edge[axis] = slice(0, 1) if shift == 1 else slice(-1, None)
            moved[tuple(edge)] = 0.0
            spread = np.where(open_ & (moved > spread), moved, spread)
        known = spread
    return known
