"""Corners of square markers as intersections of straight edges.

A blurred corner of a dark square is rounded, so corner detectors place it too far inside: by 0.3 to 0.7 px in rendered
pictures. Edges have no such bias.
"""

from __future__ import annotations

import numpy as np

SAMPLES = 24
"""Number of positions along an edge."""
ALONG = (0.12, 0.88)
"""Fraction of an edge that is used; its ends are affected by the corners."""
STEPS = 21
"""Number of samples across an edge."""


def meet(grey: np.ndarray, quad: np.ndarray, modules: int) -> np.ndarray:
    """Corners (4, 2) [px] at which lines through the edges of a marker meet; `quad` itself where there are none.

    Args:
        grey: (H, W) uint8.
        quad: (4, 2) corners found so far, in order around the marker [px].
        modules: Squares of the marker's pattern along a side, with its border.
    """
    found = quad.astype(np.float64)
    for _ in range(2):  # the second pass samples across the refined edge
        lines = [_line(grey, found[i], found[(i + 1) % 4], modules) for i in range(4)]
        if any(line is None for line in lines):
            return quad.astype(np.float64)
        crossed = np.stack([_cross(lines[i - 1], lines[i]) for i in range(4)])
        if not np.isfinite(crossed).all() or np.abs(crossed - quad).max() > 3.0:
            return quad.astype(np.float64)
        found = crossed
    return found


def _line(grey: np.ndarray, start: np.ndarray, end: np.ndarray, modules: int) -> np.ndarray | None:
    """(3,) a, b, c with a x + b y = c of the edge near two corners; None if there is no clear edge."""
    from scipy.ndimage import map_coordinates

    way = end - start
    length = float(np.hypot(*way))
    if length < 8:
        return None
    normal = np.array([-way[1], way[0]]) / length
    reach = float(np.clip(0.7 * length / modules, 1.5, 4.0))
    across = np.linspace(-reach, reach, STEPS)
    places = start + np.linspace(*ALONG, SAMPLES)[:, None] * way
    points = places[:, None] + across[None, :, None] * normal
    values = map_coordinates(grey.astype(np.float64), [points[..., 1], points[..., 0]], order=1, mode="nearest")
    steps = np.gradient(values, across, axis=1)
    steps = steps * np.sign(np.median(values[:, -1] - values[:, 0]))  # all samples must be brighter on the same side
    weight = np.clip(steps - 0.2 * steps.max(axis=1, keepdims=True), 0.0, None)
    total = weight.sum(axis=1)
    clear = total > 0.3 * np.median(total)
    if not np.median(total) > 0 or clear.sum() < SAMPLES // 2:
        return None
    middle = (weight * across).sum(axis=1)[clear] / total[clear]
    edge = places[clear] + middle[:, None] * normal
    keep = np.ones(len(edge), bool)
    for _ in range(3):
        centre = edge[keep].mean(axis=0)
        direction = np.linalg.svd(edge[keep] - centre)[2][0]
        side = np.array([-direction[1], direction[0]])
        off = np.abs((edge - centre) @ side)
        keep = off <= max(2.5 * float(np.median(off[keep])), 0.05)
    return np.append(side, side @ centre)


def _cross(one: np.ndarray | None, other: np.ndarray | None) -> np.ndarray:
    """Intersection (2,) of two lines; NaN if they are parallel."""
    assert one is not None
    assert other is not None
    matrix = np.stack([one[:2], other[:2]])
    if abs(np.linalg.det(matrix)) < 0.05:
        return np.full(2, np.nan)
    return np.asarray(np.linalg.solve(matrix, np.array([one[2], other[2]])))
