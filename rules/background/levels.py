"""Collision boxes of level surfaces of the room: shelf boards, tops of cupboards, steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.scenes.scene import SupportBox

from .grids import rectangles
from .patch import SUPPORT
from .scenery import Scenery
from .shell import Room

LEVEL = 0.97
"""Cosine of the angle to the vertical up to which a surface is level."""
OFF_M = 0.015
"""Minimum distance of a level surface from the support and the floor, which have their own boxes [m]."""
CELL_M = 0.03
"""Cell in which a level is divided [m]."""
LEAST_M2 = 0.005
"""Smallest rectangle of a level [m^2]."""


@dataclass(frozen=True)
class Level:
    """An upright rectangle of a level surface, in the room's axes."""

    low: np.ndarray
    """(2,) corner [m]."""
    high: np.ndarray
    """(2,) opposite corner [m]."""
    height_m: float
    """Of the surface, world frame [m]."""

    def under(self, low: np.ndarray, high: np.ndarray) -> bool:
        """Whether the centre of a box, corners (3,), is inside the rectangle, and its top above it."""
        middle = (low[:2] + high[:2]) / 2
        within = (middle > self.low - CELL_M).all() and (middle < self.high + CELL_M).all()
        return bool(within and low[2] < self.height_m < high[2])


def levels(scenery: Scenery, room: Room) -> list[Level]:
    """Rectangles of level planes that can carry objects, except the support and the floor."""
    found = []
    for patch in scenery.patches:
        if patch.plane is None or patch.number == SUPPORT:
            continue
        if float(scenery.world_from_camera[2, :3] @ patch.plane[0]) < LEVEL:
            continue
        points = scenery.points_of(patch.number) @ room.axes.T
        height = float(np.median(points[:, 2])) if len(points) else 0.0
        if abs(height) > OFF_M and height > room.low[2] + OFF_M:
            found += _of(points, height)
    return found


def beyond(seen: np.ndarray, feet: np.ndarray, box: SupportBox, room: Room) -> list[Level]:
    """Rectangles of the support's plane outside its box: other visible regions of it, and places where things stand.

    Args:
        seen: (N, 3) visible points of the plane, world frame [m].
        feet: (F, 2) points of things that stand on the plane, projected onto it [m].
        box: The support's box, whose sides are parallel to the room's.
        room: Its axes.
    """
    around = np.stack(np.meshgrid(*2 * [CELL_M * np.array([-1.0, 0.0, 1.0])]), axis=-1).reshape(-1, 2)
    places = np.concatenate([seen[:, :2], (feet[:, None] + around).reshape(-1, 2)])
    local = np.column_stack([places, np.zeros(len(places))]) @ room.axes.T
    middle = np.array(box.centre) @ room.axes.T
    outside = (np.abs(local - middle)[:, :2] > box.half_size[:2]).any(axis=1)
    return _of(local[outside], 0.0) if outside.any() else []


def _of(points: np.ndarray, height: float) -> list[Level]:
    from scipy import ndimage

    cells = np.floor(points[:, :2] / CELL_M).astype(np.int64)
    start = cells.min(axis=0) - 1
    grid = np.zeros(cells.max(axis=0) - start + 2, bool)
    grid[tuple((cells - start).T)] = True
    grid = ndimage.binary_fill_holes(ndimage.binary_closing(grid, np.ones((3, 3), bool)))
    found = []
    for low, high in rectangles(grid):
        # Cells extend beyond the edge of the surface; its points do not.
        own = points[((cells - start >= low) & (cells - start < high)).all(axis=1), :2]
        if len(own) and np.prod(own.max(axis=0) - own.min(axis=0)) >= LEAST_M2:
            found.append(Level(own.min(axis=0), own.max(axis=0), height))
    return found
