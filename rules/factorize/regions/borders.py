"""Objects that the picture's border cuts: how much of each is in view.

The rest of an object is completed by symmetry if most of it is in view: one side of a round body beyond its axis, a
foot on the support, or a narrow part such as a handle. How far a box continues beyond the border cannot be known.
"""

from __future__ import annotations

import numpy as np

from dextera_build.geometry.depth_view import DepthView
from dextera_build.geometry.revolution import off_axis, vertical_axis

from ..overlap import Box
from .patches import Surfaces
from .relations import Group

LEFT, TOP, RIGHT, BOTTOM = range(4)
"""Sides of the picture: the quarter turns (`numpy.rot90`) that make each the left one."""
MOST = 0.6
"""Least fraction of a cut object in view at which it is an object."""
BAND = 2
"""Objects nearer to the border than this are cut [px]."""
LEAST_M2, LEAST_M = 0.0015, 0.025
"""Least visible surface [m^2] and height [m] of an object at the border; smaller ones are ends of the support."""
NARROW = 0.6
"""Largest extent of an object along the border, relative to its largest one parallel to it, at which a corner or a
handle is cut off."""
UPRIGHT = 0.35
"""Least level part of the normals of a side."""
FEWEST = 30
"""Minimum number of blocks with such normals."""
ROUND = 0.15
"""Largest median distance of the normals' lines from the axis of a round body, relative to its radius."""
TURNED = 0.15
"""Least variance of the direction of a round body's normals, of at most one half; that of a flat face is 0."""
BESIDE = 24
"""Distance from a cut foot, along the border, within which the support must be seen [px]."""


def touched(mask: np.ndarray) -> tuple[int, ...]:
    """Sides of the picture that a mask (H, W) bool touches."""
    return tuple(side for side in (LEFT, TOP, RIGHT, BOTTOM) if np.rot90(mask, side)[:, :BAND].any())


def sides(box: Box, size: tuple[int, int]) -> list[str]:
    """Sides of a picture of `size` (width, height) that a box touches."""
    left, top, right, bottom = box
    near = {"left": left, "top": top, "right": size[0] - right, "bottom": size[1] - bottom}
    return [side for side, distance in near.items() if distance < BAND]


def in_view(s: Surfaces, group: Group, mask: np.ndarray, floor: np.ndarray, seen: DepthView) -> float:
    """Fraction of an object inside the picture, 0 if that cannot be known.

    Args:
        s: The crop that contains it.
        group: The object.
        mask: (H, W) bool, its pixels.
        floor: (H, W) bool, pixels of the support.
        seen: The upright picture.
    """
    share = 1.0
    for side in touched(mask):
        known = [_narrow(np.rot90(mask, side))]
        if side in (LEFT, RIGHT):
            known.append(_round(s, group, _towards(mask.shape, seen.k, seen.world_from_camera, side)))
        if side == BOTTOM:
            known.append(above_border(s, group, mask, floor))
        share *= max(known)
    return share


def _narrow(mask: np.ndarray) -> float:
    """Share of an ellipse cut at the same relative width at its far end; 0 if a mask is wide at its left border."""
    extent = mask.sum(axis=0)
    ratio = float(extent[:BAND].max() / extent.max())
    if ratio > NARROW:
        return 0.0
    angle = np.arcsin(ratio)
    return float(1.0 - (angle - np.sin(angle) * np.cos(angle)) / np.pi)


def _round(s: Surfaces, group: Group, inwards: tuple[np.ndarray, float]) -> float:
    """Share of the footprint of an upright round body inside a side of the view; 0 for other bodies.

    Args:
        s: The crop that contains it.
        group: The body.
        inwards: Plane of the side of the view: unit normal (3,) into the view, and offset [m].
    """
    normals, points = s.normal.reshape(-1, 3)[group.pixels], s.points.reshape(-1, 3)[group.pixels]
    level = np.linalg.norm(normals[:, :2], axis=1)
    side = level > UPRIGHT
    if side.sum() < FEWEST:
        return 0.0
    around, places = normals[side, :2] / level[side, None], points[side, :2]
    if float(1.0 - np.linalg.eigvalsh(around.T @ around / len(around))[-1]) < TURNED:
        return 0.0
    centre = vertical_axis(places, around)
    radius = float(np.quantile(np.linalg.norm(places - centre, axis=1), 0.9))
    if float(np.median(np.abs(off_axis(places, around, centre)))) > ROUND * radius:
        return 0.0
    normal, offset = inwards
    middle = np.array([*centre, float(np.median(points[:, 2]))])
    # Distance of the axis from the line in which the side of the view meets the level of the body's middle.
    distance = float(normal @ middle + offset) / max(float(np.linalg.norm(normal[:2])), 1e-9)
    angle = np.arccos(np.clip(distance / radius, -1.0, 1.0))
    return float(1.0 - (angle - np.sin(angle) * np.cos(angle)) / np.pi)


def _towards(shape: tuple[int, ...], k: np.ndarray, pose: np.ndarray, side: int) -> tuple[np.ndarray, float]:
    """The plane of the left or right side of the view in the world, its unit normal into the view."""
    column = -0.5 if side == LEFT else shape[1] - 0.5
    normal = np.array([1.0, 0.0, -(column - k[0, 2]) / k[0, 0]]) * (1.0 if side == LEFT else -1.0)
    normal = pose[:3, :3] @ (normal / np.linalg.norm(normal))
    return normal, -float(normal @ pose[:3, 3])


def above_border(s: Surfaces, group: Group, mask: np.ndarray, floor: np.ndarray) -> float:
    """Share of the height above the lower border of an object beside which the support is seen there, else 0."""
    columns = np.flatnonzero(mask[-BAND:].any(axis=0))
    beside = floor[-BAND - 1 :]
    seen = (
        beside[:, max(0, columns[0] - BESIDE) : columns[0]].any() or beside[:, columns[-1] : columns[-1] + BESIDE].any()
    )
    if not seen:
        return 0.0
    heights = s.height.ravel()[group.pixels]
    rows = group.pixels // s.height.shape[1]
    lowest = float(np.median(heights[rows >= rows.max() - 1]))
    return float(np.clip(1.0 - lowest / group.top_m, 0.0, 1.0))
