"""Motion between two pictures by optical flow, and the affine motion of a region."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_INNER = 7
"""Width of the window that must be inside a region for its centre to be an inner pixel [px]: flow is smoothed, so that
it mixes the motions of both sides at the border of a region."""
_FEWEST = 20
"""Minimum number of points that determine a motion."""
_MOST = 5000
"""Maximum number of points used."""
_ROUNDS = 4


@dataclass(frozen=True)
class Flow:
    """Dense optical flow between two grey pictures of one size."""

    there: np.ndarray
    """(H, W, 2) float32, column and row displacement from a pixel of the first picture to the second [px]."""
    back: np.ndarray
    """(H, W, 2) float32, from a pixel of the second picture to the first [px]."""
    consistent: np.ndarray
    """(H, W) bool, pixels of the first picture whose forward and backward flow return to themselves, inside the
    second."""


def flow(first: np.ndarray, second: np.ndarray) -> Flow:
    """DIS optical flow (Kroeger et al., 2016) of (H, W) uint8, in both directions.

    Forward and backward flow are consistent within the bound of Sundaram et al. (2010).
    """
    import cv2

    dis = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    nothing = np.zeros((*first.shape, 2), np.float32)
    there, back = dis.calc(first, second, nothing.copy()), dis.calc(second, first, nothing.copy())
    ends = grid(first.shape) + there
    returned = cv2.remap(back, ends, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    lengths = (there**2).sum(-1) + (returned**2).sum(-1)
    inside = ((ends >= 0) & (ends <= np.array(first.shape[::-1]) - 1)).all(-1)
    consistent = (((there + returned) ** 2).sum(-1) < 0.01 * lengths + 0.5) & inside
    return Flow(there, back, consistent)


def grid(shape: tuple[int, ...]) -> np.ndarray:
    """Column and row of each pixel, (H, W, 2) float32."""
    rows, columns = np.indices(shape[:2], dtype=np.float32)
    return np.stack([columns, rows], axis=-1)


def affine(seen: Flow, region: np.ndarray, least: float) -> tuple[np.ndarray | None, float]:
    """The affine motion (3, 3) of a region of the first picture, and the fraction of the region with consistent flow.

    The motion is fitted to the consistent flow inside the region by least squares, without points whose residual
    exceeds 2.5 medians. It is None if less than `least` of the region is consistent, or if there are too few points.
    """
    import cv2

    inner = cv2.erode(region.astype(np.uint8), np.ones((_INNER, _INNER), np.uint8)) > 0
    inner = inner if inner.sum() >= 2 * _FEWEST else region
    rows, columns = np.nonzero(inner & seen.consistent)
    share = len(rows) / max(int(inner.sum()), 1)
    if len(rows) < _FEWEST or share < least:
        return None, share
    step = -(-len(rows) // _MOST)
    rows, columns = rows[::step], columns[::step]
    points = np.stack([columns, rows, np.ones(len(rows))], axis=1)
    ways = seen.there[rows, columns].astype(np.float64)
    used: np.ndarray = np.ones(len(rows), bool)
    change: np.ndarray = np.zeros((3, 2))
    for _ in range(_ROUNDS):
        change = np.linalg.lstsq(points[used], ways[used], rcond=None)[0]
        off = np.linalg.norm(points @ change - ways, axis=1)
        used = off <= max(0.3, 2.5 * float(np.median(off[used])))
    matrix = np.eye(3)
    matrix[:2] += change.T
    return matrix, share
