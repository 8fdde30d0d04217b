"""The support as a closed slab: cut at its outline, continued where the picture cuts it."""

from __future__ import annotations

import cv2
import numpy as np

from dextera_build.geometry import cameras, regions, transforms

from .patches import SUPPORT
from .pieces import Piece
from .scenery import Scenery
from .synthesis import membrane

BEYOND_M = 0.4
"""How far a support goes on beyond the picture's border that cuts it [m]."""
UNDER_M = 0.001
"""The slab's top is this far below the surface that was photographed [m]."""
ROUGH_M = 0.015
"""Tolerance of the simplified outline [m]."""
TEXELS = 256
"""Longest edge of the slab's picture."""


def broad(mask: np.ndarray) -> np.ndarray:
    """The largest part of a mask (H, W) without what hangs on by a neck: other things cross the support's height."""
    side = max(3, mask.shape[1] // 40)
    ones = np.ones((side, side), np.uint8)
    count, labels, facts, _ = cv2.connectedComponentsWithStats(
        cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, ones), connectivity=4
    )
    if count < 2:
        return mask
    main = labels == 1 + int(np.argmax(facts[1:, cv2.CC_STAT_AREA]))
    return np.asarray((cv2.dilate(main.astype(np.uint8), ones) > 0) & mask)


def outline(scenery: Scenery, polygon: np.ndarray) -> np.ndarray:
    """Convex outline (P, 2) of the whole support [m]: what was seen, longer where the picture's border cuts it.

    Args:
        scenery: What was seen.
        polygon: (Q, 2) convex outline of its measured part [m].
    """
    height, width = scenery.labels.shape
    rows, columns = np.nonzero(broad(scenery.labels == SUPPORT))
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
    hull = hull if regions.area(hull) > 0 else hull[::-1]
    back = np.linalg.inv(scenery.world_from_camera)
    corners = transforms.apply(back, np.concatenate([hull, np.zeros((len(hull), 1))], axis=1))
    place = cameras.project(np.where(corners[:, 2:] > 0.05, corners, 1e-3), scenery.k)
    rim = 0.015 * width
    border = np.stack(
        [place[:, 0] < rim, place[:, 0] > width - 1 - rim, place[:, 1] < rim, place[:, 1] > height - 1 - rim], axis=1
    )
    cut = (border & np.roll(border, -1, axis=0)).any(axis=1)
    return _moved_out(hull, np.where(cut, BEYOND_M, 0.0))


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
    colour, shown = scenery.colours(flat, 0.02)
    picture = membrane(np.where(shown[..., None], colour, 0.0).astype(np.float32), shown)
    picture = np.clip(picture, 0, 255).astype(np.uint8)
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
