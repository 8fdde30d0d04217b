"""The support as a closed slab: cut at its outline, continued where the picture cuts it."""

from __future__ import annotations

import cv2
import numpy as np

from dextera_build.geometry import cameras, regions, transforms

from .patches import SUPPORT
from .pieces import Piece
from .scenery import Scenery
from .synthesis import fill_texture, membrane

BEYOND_M = 0.25
"""How far a support goes on beyond the picture's border that cuts it [m]."""
UNDER_M = 0.001
"""The slab's top is this far below the surface that was photographed [m]."""
ROUGH_M = 0.03
"""Tolerance of the simplified outline [m]."""
CORNER_M = 0.4
"""A hidden corner is at most this far from what was seen beside it [m]."""
TEXELS = 512
"""Longest edge of the slab's picture."""


def broad(mask: np.ndarray) -> np.ndarray:
    """The largest part of a mask (H, W) without what hangs on by a neck: other things cross the support's height."""
    ones = _square(mask.shape[1])
    count, labels, facts, _ = cv2.connectedComponentsWithStats(
        cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, ones), connectivity=4
    )
    if count < 2:
        return mask
    main = labels == 1 + int(np.argmax(facts[1:, cv2.CC_STAT_AREA]))
    return np.asarray((cv2.dilate(main.astype(np.uint8), ones) > 0) & mask)


def _square(width: int) -> np.ndarray:
    side = max(3, width // 40)
    return np.ones((side, side), np.uint8)


def outline(scenery: Scenery, polygon: np.ndarray, hidden: np.ndarray) -> np.ndarray:
    """Convex outline (P, 2) of the whole support [m]: what was seen, longer where the picture's border cuts it.

    Args:
        scenery: What was seen.
        polygon: (Q, 2) convex outline of its measured part [m].
        hidden: (H, W) pixels that showed something else: no outline is read from them.
    """
    _height, width = scenery.labels.shape
    visible = broad(scenery.labels == SUPPORT) & ~hidden
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
    hull = cv2.approxPolyDP(hull.astype(np.float32)[:, None], ROUGH_M, True)[:, 0].astype(np.float64)
    if len(hull) < 3:
        return polygon
    hull = _cornered(hull if regions.area(hull) > 0 else hull[::-1], scenery, hidden)
    return _moved_out(hull, np.where(_cut(hull, scenery), BEYOND_M, 0.0))


def _pixels(points: np.ndarray, scenery: Scenery) -> np.ndarray:
    """Pixels (N, 2), column and row, of points (N, 2) on the support; far outside the picture if behind the camera."""
    level = np.concatenate([points, np.zeros((len(points), 1))], axis=1)
    seen = transforms.apply(np.linalg.inv(scenery.world_from_camera), level)
    found = cameras.project(np.where(seen[:, 2:] > 0.05, seen, 1.0), scenery.k)
    return np.where(seen[:, 2:] > 0.05, found, -1e6)


def _cut(hull: np.ndarray, scenery: Scenery) -> np.ndarray:
    """Which edges (P,) of the outline, each from its corner on, lie along the picture's border."""
    height, width = scenery.labels.shape
    rim = 0.015 * width
    place = _pixels(hull, scenery)
    low, high = place < rim, place > np.array([width, height]) - 1 - rim
    border = np.concatenate([low, high], axis=1)
    return np.asarray((border & np.roll(border, -1, axis=0)).any(axis=1))


def _cornered(hull: np.ndarray, scenery: Scenery, hidden: np.ndarray) -> np.ndarray:
    """The outline with the corners that something hid: where two edges meet behind what was taken out."""
    number = 0
    while number < len(hull) and len(hull) > 3:
        before, a, b, after = (hull[(number + n) % len(hull)] for n in (-1, 0, 1, 2))
        corner = _meeting(before, a, after, b)
        if (
            corner is not None
            and not _cut(hull, scenery)[number]
            and _unseen(np.stack([a, b, corner]), scenery, hidden)
        ):
            rest = [hull[(number + n) % len(hull)] for n in range(2, len(hull))]
            hull, number = np.array([corner, *rest]), 0
        else:
            number += 1
    return hull


def _meeting(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray | None:
    """Where the ray from a through b meets the one from c through d, beyond b and d; None if nowhere near."""
    first, second = b - a, d - c
    cross = first[0] * second[1] - first[1] * second[0]
    if abs(cross) < 0.1 * np.linalg.norm(first) * np.linalg.norm(second):
        return None
    along = ((c - a)[0] * second[1] - (c - a)[1] * second[0]) / cross
    found = a + along * first
    ahead = along > 1 and (found - d) @ second > 0
    return found if ahead and np.linalg.norm(found - (b + d) / 2) < CORNER_M else None


def _unseen(triangle: np.ndarray, scenery: Scenery, hidden: np.ndarray) -> bool:
    """Whether nothing else was seen in a triangle of the support's plane."""
    height, width = scenery.labels.shape
    share = np.array([[i, j, 12 - i - j] for i in range(1, 12) for j in range(1, 12 - i)]) / 12
    pixel = np.round(_pixels(share @ triangle, scenery)).astype(np.int64)
    inside = (pixel >= 0).all(axis=1) & (pixel[:, 0] < width) & (pixel[:, 1] < height)
    column, row = pixel[inside].T
    other = ~hidden[row, column] & (scenery.labels[row, column] > 0) & (scenery.labels[row, column] != SUPPORT)
    return bool((~other).sum() >= 0.9 * inside.sum())


def _moved_out(hull: np.ndarray, far: np.ndarray) -> np.ndarray:
    """A convex polygon with each edge moved outwards by its own distance."""
    low, high = hull.min(axis=0) - 2 * BEYOND_M, hull.max(axis=0) + 2 * BEYOND_M
    found = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    for a, b, distance in zip(hull, np.roll(hull, -1, axis=0), far, strict=True):
        edge = (b - a) / np.linalg.norm(b - a)
        outward = np.array([edge[1], -edge[0]])
        found = _clipped(found, outward, float(outward @ a) + float(distance))
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


def slab(scenery: Scenery, edge: np.ndarray, thickness: float) -> list[Piece]:
    """Top, sides and underside of the support.

    Args:
        scenery: What was seen.
        edge: (P, 2) convex outline, counter-clockwise [m].
        thickness: Guessed [m].
    """
    count = len(edge)
    low = edge.min(axis=0)
    texel = float(np.ptp(edge, axis=0).max()) / TEXELS
    width, height = (int(n) for n in np.ceil(np.ptp(edge, axis=0) / texel) + 1)
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    flat = np.stack([low[0] + columns * texel, low[1] + rows * texel, np.zeros(rows.shape)], axis=-1)
    colour, shown = scenery.colours(flat, 0.02, unmeasured=True)
    shown = cv2.erode(shown.astype(np.uint8), np.ones((5, 5), np.uint8), borderValue=0) > 0
    picture = np.clip(_continued(colour, shown), 0, 255).astype(np.uint8)
    pixel = (edge - low) / texel
    fan = np.array([[0, i, i + 1] for i in range(1, count - 1)])
    top, bottom = (np.concatenate([edge, np.full((count, 1), z)], axis=1) for z in (-UNDER_M, -thickness))
    ring = np.arange(count)
    after = np.roll(ring, -1)
    sides = np.concatenate(
        [np.stack([ring, ring + count, after], axis=1), np.stack([after, ring + count, after + count], axis=1)]
    )
    dark = np.clip(0.75 * picture.astype(np.float32), 0, 255).astype(np.uint8)
    return [
        Piece(top, fan, pixel, picture),
        Piece(np.concatenate([top, bottom]), sides, np.concatenate([pixel, pixel]), dark),
        Piece(bottom, fan[:, ::-1], pixel, dark),
    ]


def _continued(colour: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """A top view with the texture of its seen part everywhere; none if hardly anything was seen."""
    if shown.sum() < 500:
        return membrane(np.where(shown[..., None], colour, 0.0).astype(np.float32), shown)
    return fill_texture(colour, ~shown, shown, np.ones(shown.shape, np.float32))
