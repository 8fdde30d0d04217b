"""Connected regions of masks and outlines of point sets."""

from __future__ import annotations

import numpy as np


def box_of(mask: np.ndarray) -> tuple[int, int, int, int]:
    """Left, top, right, bottom of the pixels of a mask (H, W) bool, right and bottom excluded [px]."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def label(mask: np.ndarray) -> tuple[np.ndarray, int]:
    """4-connected regions of a (H, W) bool mask: (H, W) int32 with 1.. in scan order, and their number."""
    from scipy import ndimage

    labels, count = ndimage.label(mask)
    return labels, count


def largest(mask: np.ndarray, weight: np.ndarray | None = None) -> np.ndarray:
    """The 4-connected region of a mask with the most pixels, or the largest sum of `weight`; empty stays empty."""
    labels, count = label(mask)
    if not count:
        return mask.copy()
    weights = mask if weight is None else weight
    sums = np.bincount(labels.ravel(), weights=weights.ravel().astype(np.float64), minlength=count + 1)
    sums[0] = -1.0
    return np.asarray(labels == int(np.argmax(sums)))


def convex_hull(points: np.ndarray) -> np.ndarray:
    """Corners (P, 2) of the convex hull of (N, 2) points, counter-clockwise (Andrew's monotone chain)."""
    unique = np.unique(_outer(points) if len(points) > 200 else points, axis=0)
    if len(unique) < 3:
        return unique
    lower, upper = _chain(unique), _chain(unique[::-1])
    return np.array(lower[:-1] + upper[:-1])


def area(polygon: np.ndarray) -> float:
    """Signed area of a (P, 2) polygon; positive when counter-clockwise."""
    x, y = polygon[:, 0], polygon[:, 1]
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def centroid(polygon: np.ndarray) -> np.ndarray:
    """Centre of area (2,) of a simple (P, 2) polygon."""
    following = np.roll(polygon, -1, axis=0)
    cross = polygon[:, 0] * following[:, 1] - following[:, 0] * polygon[:, 1]
    return np.asarray(((polygon + following) * cross[:, None]).sum(axis=0) / (3.0 * cross.sum()))


def inside_convex(points: np.ndarray, polygon: np.ndarray, margin: float = 0.0) -> np.ndarray:
    """Which of (..., 2) points are inside a convex counter-clockwise polygon expanded by `margin`."""
    x, y = points[..., 0].ravel(), points[..., 1].ravel()
    left = np.arange(len(x))
    following = np.roll(polygon, -1, axis=0)
    # Most points are outside: edges far apart from one another exclude them early.
    for corner in np.argsort(np.arange(len(polygon)) * 0.618034 % 1.0, kind="stable"):
        a, b = polygon[corner], following[corner]
        edge = (b - a) / max(float(np.linalg.norm(b - a)), 1e-12)
        within = edge[0] * (y - a[1]) - edge[1] * (x - a[0]) >= -margin
        if not within.all():
            x, y, left = x[within], y[within], left[within]
    inside = np.zeros(points.shape[:-1], bool)
    inside.ravel()[left] = True
    return inside


def _outer(points: np.ndarray) -> np.ndarray:
    """The points outside the polygon of the extreme ones (Akl and Toussaint 1978)."""
    angle = np.arange(32) * np.pi / 16
    extremes = np.argmax(points @ np.stack([np.cos(angle), np.sin(angle)]), axis=0)
    polygon = points[extremes]
    polygon = polygon[np.any(polygon != np.roll(polygon, 1, axis=0), axis=1)]
    inner = np.ones(len(points), bool)
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        inner &= (b[0] - a[0]) * (points[:, 1] - a[1]) - (b[1] - a[1]) * (points[:, 0] - a[0]) > 0
    return points[~inner] if len(polygon) > 2 else points


def _chain(points: np.ndarray) -> list[np.ndarray]:
    chain: list[np.ndarray] = []
    for point in points:
        while len(chain) > 1 and _turn(chain[-2], chain[-1], point) <= 0:
            chain.pop()
        chain.append(point)
    return chain


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def without_pinholes(mask: np.ndarray) -> np.ndarray:
    """A mask (H, W) bool without holes smaller than 1/500 of it, which are errors, not handles."""
    holes, _ = label(~mask)
    sizes = np.bincount(holes.ravel())
    small = sizes < max(12.0, 0.002 * np.count_nonzero(mask))
    small[0] = False
    return np.asarray(mask | small[holes])


def connected(mask: np.ndarray, right: np.ndarray, below: np.ndarray) -> tuple[np.ndarray, int]:
    """Connected regions (H, W) int32, 1.., of a mask, without connections across steps, and their number."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    index = np.cumsum(mask.reshape(-1)).reshape(mask.shape) - 1
    pairs = []
    for joined, first, second in (
        (~right & mask[:, :-1] & mask[:, 1:], index[:, :-1], index[:, 1:]),
        (~below & mask[:-1] & mask[1:], index[:-1], index[1:]),
    ):
        pairs.append(np.stack([first[joined], second[joined]]))
    one, other = np.concatenate(pairs, axis=1)
    size = int(mask.sum())
    graph = coo_array((np.ones(len(one), np.int8), (one, other)), shape=(size, size))
    count, found = connected_components(graph, directed=False)
    labels = np.zeros(mask.shape, np.int32)
    labels[mask] = found + 1
    return labels, int(count)
