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
        step_m: Smallest depth difference that counts [m].
    """
    reach = nearest_depth(mask & (depth > 0), depth)
    nearer = raised & ~mask & (depth > 0) & (reach > 0) & (depth < reach - step_m)
    grown = nearer.copy()
    grown[1:] |= nearer[:-1]
    grown[:-1] |= nearer[1:]
    grown[:, 1:] |= nearer[:, :-1]
    grown[:, :-1] |= nearer[:, 1:]
    return np.asarray(grown & ~mask)


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
