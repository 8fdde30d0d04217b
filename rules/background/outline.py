"""The outline of the support, completed where it is occluded or cut by the picture's border."""

from __future__ import annotations

import cv2
import numpy as np

from dextera_build.geometry import cameras, regions, transforms

from .patch import SUPPORT
from .scenery import Scenery

BEYOND_M = 0.25
"""Extension of a support beyond the picture's border that cuts it [m]."""
SIMPLE_M = 0.01
"""Tolerance of the simplified outline [m]."""
ROUGH_M = 0.03
"""Visible points farther than this outside the outline are not part of the support [m]."""
RIM = 0.015
"""Uncertainty of outlines, as a fraction of the picture's width."""
NEARER_M = 0.02
"""Points nearer than the support by this much are in front of it [m]."""
CORNER_M = 0.4
"""Maximum distance of a hidden corner from the visible part next to it [m]."""


def broad(mask: np.ndarray) -> np.ndarray:
    """The largest part of a mask (H, W) without parts attached by a neck, which belong to other objects."""
    ones = _square(mask.shape[1])
    count, labels, facts, _ = cv2.connectedComponentsWithStats(
        cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, ones), connectivity=4
    )
    if count < 2:
        return mask
    main = labels == 1 + int(np.argmax(facts[1:, cv2.CC_STAT_AREA]))
    return np.asarray((cv2.dilate(main.astype(np.uint8), ones) > 0) & mask)


def _side(width: int) -> int:
    """Width below which parts of the support may be something else [px]."""
    return max(3, width // 40)


def _square(width: int) -> np.ndarray:
    return np.ones((_side(width), _side(width)), np.uint8)


def outline(scenery: Scenery, polygon: np.ndarray, hidden: np.ndarray) -> np.ndarray:
    """Convex outline (P, 2) of the whole support [m]: the visible outline, extended where the picture's border cuts it.

    Args:
        scenery: The visible empty scene.
        polygon: (Q, 2) convex outline of its measured part [m].
        hidden: (H, W) pixels that showed something else, from which no outline is read.
    """
    _height, width = scenery.labels.shape
    level = scenery.labels == SUPPORT
    # What stands on the support may part its visible surface from one border of the picture to another.
    visible = broad(level | hidden) & level & ~hidden
    rows, columns = np.nonzero(cv2.morphologyEx(visible.astype(np.uint8), cv2.MORPH_OPEN, _square(width)))
    some = np.s_[:: max(1, len(rows) // 20_000)]
    pixel = np.stack([columns[some], rows[some]], axis=1).astype(np.float64)
    support = next(p for p in scenery.patches if p.number == SUPPORT)
    depth = support.depth(pixel, scenery.k)
    seen = scenery.lift(pixel[np.isfinite(depth)], depth[np.isfinite(depth)])[:, :2]
    near = seen[regions.inside_convex(seen, polygon, float(np.ptp(polygon, axis=0).max()) / 2)]
    if len(near) < 3:
        return polygon
    hull = regions.convex_hull(near)
    hull = cv2.approxPolyDP(hull.astype(np.float32)[:, None], SIMPLE_M, True)[:, 0].astype(np.float64)
    if len(hull) < 3:
        return polygon
    hull = _cornered(hull if regions.area(hull) > 0 else hull[::-1], scenery, hidden)
    return _completed(hull, _cut(hull, scenery, hidden))


def _pixels(points: np.ndarray, scenery: Scenery) -> np.ndarray:
    """Pixels (N, 2), column and row, of points (N, 2) on the support; far outside the picture if behind the camera."""
    level = np.concatenate([points, np.zeros((len(points), 1))], axis=1)
    seen = transforms.apply(np.linalg.inv(scenery.world_from_camera), level)
    found = cameras.project(np.where(seen[:, 2:] > 0.05, seen, 1.0), scenery.k)
    return np.where(seen[:, 2:] > 0.05, found, -1e6)


def _cut(hull: np.ndarray, scenery: Scenery, hidden: np.ndarray) -> np.ndarray:
    """Edges (P,) of the outline, each starting at its corner, that are along the picture's border.

    Corners are accurate to the width of parts that `outline` removes, and to its tolerance. An edge is not cut if
    something else is visible beyond it.
    """
    height, width = scenery.labels.shape
    place = _pixels(hull, scenery)
    level = np.concatenate([hull, np.zeros((len(hull), 1))], axis=1)
    depth = transforms.apply(np.linalg.inv(scenery.world_from_camera), level)[:, 2]
    rim = (RIM * width + _side(width) + ROUGH_M * scenery.k[0, 0] / np.maximum(depth, 0.05))[:, None]
    low, high = place < rim, place > np.array([width, height]) - 1 - rim
    border = np.concatenate([low, high], axis=1)
    along = (border & np.roll(border, -1, axis=0)).any(axis=1)
    after, outward = np.roll(hull, -1, axis=0), _outward(hull)
    share = np.linspace(0.05, 0.95, 19)[:, None]
    for number in np.flatnonzero(along):
        beyond = hull[number] * (1 - share) + after[number] * share + 2 * ROUGH_M * outward[number]
        along[number] = _other(beyond, scenery, hidden).mean() < 0.3
    return np.asarray(along)


def _outward(hull: np.ndarray) -> np.ndarray:
    """Unit normals (P, 2) of the edges of a counter-clockwise outline, each from its corner on."""
    edges = np.roll(hull, -1, axis=0) - hull
    return np.asarray(np.stack([edges[:, 1], -edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1, keepdims=True))


def _other(points: np.ndarray, scenery: Scenery, hidden: np.ndarray) -> np.ndarray:
    """Points (N, 2) of the support's plane at which something else is visible."""
    height, width = scenery.labels.shape
    pixel = np.round(_pixels(points, scenery)).astype(np.int64)
    inside = (pixel >= 0).all(axis=1) & (pixel[:, 0] < width) & (pixel[:, 1] < height)
    column, row = np.where(inside[:, None], pixel, 0).T
    label, depth = scenery.labels[row, column], scenery.depth[row, column]
    level = np.concatenate([points, np.zeros((len(points), 1))], axis=1)
    plane = transforms.apply(np.linalg.inv(scenery.world_from_camera), level)[:, 2]
    # Nearer objects only occlude the support.
    nearer = (depth > 0) & (depth < plane - NEARER_M)
    return np.asarray(inside & ~hidden[row, column] & (label != SUPPORT) & ~nearer)


def _cornered(hull: np.ndarray, scenery: Scenery, hidden: np.ndarray) -> np.ndarray:
    """The outline with hidden corners, at the intersections of two edges behind removed pixels."""
    number = 0
    while number < len(hull) and len(hull) > 3:
        before, a, b, after = (hull[(number + n) % len(hull)] for n in (-1, 0, 1, 2))
        corner = _meeting(before, a, after, b)
        if (
            corner is not None
            and not _cut(hull, scenery, hidden)[number]
            and _unseen(np.stack([a, b, corner]), scenery, hidden)
        ):
            rest = [hull[(number + n) % len(hull)] for n in range(2, len(hull))]
            hull, number = np.array([corner, *rest]), 0
        else:
            number += 1
    return hull


def _meeting(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray | None:
    """Intersection of the ray from a through b with the one from c through d, beyond b and d; None if far away."""
    first, second = b - a, d - c
    cross = first[0] * second[1] - first[1] * second[0]
    if abs(cross) < 0.1 * np.linalg.norm(first) * np.linalg.norm(second):
        return None
    along = ((c - a)[0] * second[1] - (c - a)[1] * second[0]) / cross
    found = a + along * first
    ahead = along > 1 and (found - d) @ second > 0
    return found if ahead and np.linalg.norm(found - (b + d) / 2) < CORNER_M else None


def _unseen(triangle: np.ndarray, scenery: Scenery, hidden: np.ndarray) -> bool:
    """Whether nothing else is visible in a triangle of the support's plane."""
    share = np.array([[i, j, 12 - i - j] for i in range(1, 12) for j in range(1, 12 - i)]) / 12
    place = _pixels(share @ triangle, scenery)
    inside = ((place > -0.5) & (place < np.array(scenery.labels.shape[::-1]) - 0.5)).all(axis=1)
    return bool(_other((share @ triangle)[inside], scenery, hidden).sum() <= 0.1 * inside.sum())


def _completed(hull: np.ndarray, cut: np.ndarray) -> np.ndarray:
    """A convex outline extended where the picture's border cuts it, up to a rectangle along its longest edge.

    Most tables are rectangles; visible edges are kept.
    """
    edges = np.roll(hull, -1, axis=0) - hull
    if not cut.any() or cut.all():
        return hull
    length = np.where(cut, 0.0, np.linalg.norm(edges, axis=1))
    along = edges[int(np.argmax(length))] / length.max()
    axes = np.array([along, [-along[1], along[0]]])
    outward = _outward(hull)
    found = _around(hull, np.where(cut, BEYOND_M, 0.0), outward)
    low, high = (found @ axes.T).min(axis=0), (found @ axes.T).max(axis=0)
    found = np.array([low, [high[0], low[1]], high, [low[0], high[1]]]) @ axes
    for corner, normal in zip(hull[~cut], outward[~cut], strict=True):
        found = _clipped(found, normal, float(normal @ corner))
    return found


def _around(hull: np.ndarray, far: np.ndarray, outward: np.ndarray) -> np.ndarray:
    """A convex polygon with each edge moved outwards (P, 2) by its own distance (P,)."""
    low, high = hull.min(axis=0) - 2 * BEYOND_M, hull.max(axis=0) + 2 * BEYOND_M
    found = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    for corner, normal, distance in zip(hull, outward, far, strict=True):
        found = _clipped(found, normal, float(normal @ corner) + float(distance))
    return found


def _clipped(polygon: np.ndarray, normal: np.ndarray, most: float) -> np.ndarray:
    """The part of a convex polygon with normal . p <= most (Sutherland and Hodgman 1974)."""
    kept: list[np.ndarray] = []
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        first, second = float(normal @ a) - most, float(normal @ b) - most
        if first <= 0:
            kept.append(a)
        if first * second < 0:
            kept.append(a + (b - a) * first / (first - second))
    return np.array(kept)
