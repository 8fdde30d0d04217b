"""Colours of upright and other flat surfaces off the support where objects were removed.

Each surface is filled from its own pixels, so that a dark floor does not run into a bright wall. What is on a wall goes
on at its height: skirting boards, tiles and edges of panels are level.
"""

from __future__ import annotations

import cv2
import numpy as np

from dextera_build.geometry import transforms

from .patch import SUPPORT, Patch
from .rectified import MOST_TEXELS, TopView
from .scenery import Scenery
from .synthesis import membrane

UPRIGHT = 0.15
"""Largest vertical part of the normal of a wall."""
LEAST = 500
"""Least number of visible pixels that a surface is filled from."""
BESIDE_M = 0.6
"""Distance on both sides of a hole from which a wall is continued [m]."""
ROW = 0.05
"""Least visible part of a row of the wall that is continued."""
MEAN = 15
"""Width of the mean along a row, which leaves no streaks [texels]."""
SAME_M = 0.04
"""Median distance of the points of a patch from a plane that it is a part of [m]."""
EDGE_PX = 2
"""Pixels at the border of a surface mix its colour with that of its neighbour [px]."""


def filled(scenery: Scenery, hole: np.ndarray) -> np.ndarray:
    """The picture (H, W, 3) uint8 with the pixels of `hole` (H, W) off the support filled, surface by surface."""
    pixels = scenery.pixels.copy()
    square = np.ones((2 * EDGE_PX + 1,) * 2, np.uint8)
    for patch, numbers in _flats(scenery):
        assert patch.plane is not None
        upright = abs(float((scenery.world_from_camera[:3, :3] @ patch.plane[0])[2])) < UPRIGHT
        own = np.isin(scenery.labels, numbers)
        gap = own & hole
        if not upright:
            # Noise far away may leave parts of a floor without a plane; on a wall, they would be continued as rows.
            own |= np.isin(scenery.labels, _curved(scenery, patch))
        known = cv2.erode((own & ~hole).astype(np.uint8), square) > 0
        if not gap.any() or known.sum() < LEAST:
            continue
        colour = _rows(scenery, patch, gap, known) if upright else _smooth(scenery.pixels, known)
        pixels[gap] = np.clip(np.round(colour[gap]), 0, 255).astype(np.uint8)
    return pixels


def _flats(scenery: Scenery) -> list[tuple[Patch, list[int]]]:
    """The largest patch of each plane off the support, and the numbers of all patches in that plane."""
    counts = np.bincount(
        scenery.labels.ravel(), minlength=1 + max((each.number for each in scenery.patches), default=0)
    )
    left = [each for each in scenery.patches if each.plane is not None and each.number != SUPPORT]
    left.sort(key=lambda each: (-int(counts[each.number]), each.number))
    found = []
    while left:
        first = left[0]
        same = [each for each in left if each is first or _coplanar(scenery, first, each)]
        found.append((first, [each.number for each in same]))
        left = [each for each in left if each not in same]
    return found


def _curved(scenery: Scenery, patch: Patch) -> list[int]:
    """The curved surfaces that are a part of a patch's plane."""
    return [each.number for each in scenery.patches if each.plane is None and _coplanar(scenery, patch, each)]


def _coplanar(scenery: Scenery, first: Patch, other: Patch) -> bool:
    """Whether most of a patch is in the plane of another one."""
    assert first.plane is not None
    points = scenery.camera_points(scenery.labels == other.number)
    distance = np.abs(points @ first.plane[0] + first.plane[1])
    return bool(len(points)) and float(np.median(distance)) < SAME_M


def _smooth(pixels: np.ndarray, known: np.ndarray) -> np.ndarray:
    return membrane(np.where(known[..., None], pixels, 0).astype(np.float32), known)


def _rows(scenery: Scenery, patch: Patch, gap: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Colours (H, W, 3) of a wall, continued along its level rows."""
    view = _front(scenery, patch, gap)
    flat, shown = view.lay(scenery.pixels.astype(np.float32)), view.lay(known.astype(np.uint8), smooth=False) > 0
    part = cv2.blur(shown.astype(np.float32), (MEAN, 1))
    mean = cv2.blur(flat * shown[..., None], (MEAN, 1)) / np.maximum(part, 1e-6)[..., None]
    columns, done = np.arange(view.width), np.zeros(view.height, bool)
    for row in np.flatnonzero(shown.mean(axis=1) > ROW):
        at = np.flatnonzero(shown[row])
        flat[row] = np.stack([np.interp(columns, at, mean[row, at, channel]) for channel in range(3)], axis=-1)
        done[row] = True
    whole = _smooth(flat, np.broadcast_to(done[:, None], shown.shape)) if done.any() else _smooth(flat, shown)
    return view.lift(whole, gap.shape)


def _front(scenery: Scenery, patch: Patch, gap: np.ndarray) -> TopView:
    """A frontal view of the wall around the hole; its rows are level."""
    assert patch.plane is not None
    normal = scenery.world_from_camera[:3, :3] @ patch.plane[0]
    along = np.cross([0.0, 0.0, 1.0], normal)
    along /= np.linalg.norm(along)
    up = np.cross(normal, along)
    points = scenery.world_points(gap)
    middle = points.mean(axis=0)
    places = (points - middle) @ np.stack([along, up], axis=-1)
    beside = np.array([BESIDE_M, 0.0])
    low, high = places.min(axis=0) - beside, places.max(axis=0) + beside
    footprint = float(np.median(scenery.depth[gap])) / float(scenery.k[0, 0])
    texel = max(footprint, float((high - low).max()) / MOST_TEXELS)
    width, height = (int(n) for n in np.ceil((high - low) / texel) + 1)
    back = transforms.invert(scenery.world_from_camera)
    pixel_from_plane = scenery.k @ np.stack(
        [back[:3, :3] @ along, back[:3, :3] @ up, transforms.apply(back, middle)], axis=1
    )
    plane_from_texel = np.array([[texel, 0, low[0]], [0, -texel, high[1]], [0, 0, 1]])
    return TopView(float(low[0]), float(high[1]), texel, width, height, pixel_from_plane @ plane_from_texel)
