"""Collision boxes of the room: floor, walls, and furniture."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from dextera_build.artifacts.scenes.scene import SupportBox

from .grids import rectangles
from .levels import OFF_M, Level, beyond, levels
from .scenery import Scenery
from .shell import Room

WALL_M = 0.1
"""Thickness of walls and floor [m]."""
BOARD_M = 0.02
"""Thickness of a level surface whose underside is not visible [m]."""
CELL_M = 0.06
"""Smallest cell in which furniture is boxed [m]."""
MOST = 48
"""Maximum number of boxes of furniture; with more, cells grow."""
THIN_M = 0.03
"""Minimum thickness of furniture [m]."""
THINNEST_M = 0.002
"""Minimum thickness of what is left of a box under a level surface [m]."""
LEAST = 3
"""Minimum number of points in a cell."""
CLEAR_M = 0.04
"""Distance between objects and boxes of furniture [m]."""


def room_boxes(room: Room) -> list[SupportBox]:
    """Boxes of floor and four walls, outside the room."""
    low, high = room.low, room.high
    middle, half = (low + high) / 2, (high - low) / 2
    boxes = [_box("floor", np.array([middle[0], middle[1], low[2] - WALL_M / 2]), [*half[:2], WALL_M / 2], room)]
    for axis, side in ((0, -1), (0, 1), (1, -1), (1, 1)):
        centre, size = middle.copy(), half.copy()
        centre[axis] += side * (half[axis] + WALL_M / 2)
        size[axis] = WALL_M / 2
        boxes.append(_box(f"wall_{2 * axis + (side > 0)}", centre, size, room))
    return boxes


def support_boxes(seen: np.ndarray, feet: np.ndarray, box: SupportBox, room: Room) -> list[SupportBox]:
    """Boxes of the support's plane outside its own box, as thick as it, see `levels.beyond`."""
    found = enumerate(beyond(seen, feet, box, room), start=1)
    return [_board(f"support_{number}", level, 2 * box.half_size[2], room) for number, level in found]


def thing_boxes(scenery: Scenery, room: Room, objects: np.ndarray, height: float) -> list[SupportBox]:
    """Boxes of all furniture, in the room's axes.

    Args:
        scenery: The visible empty scene.
        room: Walls around it; points inside the walls need no box.
        objects: (N, 3) points of movable objects [m], which boxes avoid.
        height: Thickness of the support, which has its own box [m].
    """
    points = scenery.points
    points = points[np.abs(points[:, 2] + height / 2) > height / 2 + 0.01]
    local = points @ room.axes.T
    inner = ((local > room.low + 2 * CELL_M) & (local < room.high - 2 * CELL_M)).all(axis=1)
    local, taken = local[inner], objects @ room.axes.T
    cell, found = CELL_M, _merged(local, taken, CELL_M)
    while len(found) > MOST:
        cell *= 1.3
        found = _merged(local, taken, cell)
    eye = scenery.world_from_camera[:3, 3] @ room.axes.T
    flat = levels(scenery, room)
    boxes = []
    for number, (first, last) in enumerate(found):
        for part, (low, high) in enumerate(_parted(local, first * cell, last * cell, eye, flat)):
            boxes.append(_box(f"thing_{number}" + f"_{part}" * (part > 0), (low + high) / 2, (high - low) / 2, room))
    return boxes + [_board(f"level_{number}", level, BOARD_M, room) for number, level in enumerate(flat)]


def _parted(
    local: np.ndarray, low: np.ndarray, high: np.ndarray, eye: np.ndarray, flat: Sequence[Level]
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Boxes of the points in a cell below, between and above the level surfaces that pass through it.

    A level has its own box, and the noise of its points must not stand on it. What rises above it keeps its collision.
    """
    least, most = _tight(local, low, high, eye)
    heights = sorted(level.height_m for level in flat if level.under(least, most))
    if not heights:
        yield least, most
        return
    if heights[0] - least[2] >= THINNEST_M:
        yield least, np.array([*most[:2], heights[0]])
    for height, end in zip(heights, [*heights[1:], np.inf], strict=True):
        bottom = np.array([*low[:2], max(low[2], height + OFF_M)])
        top = np.array([*high[:2], min(high[2], end)])
        if bottom[2] < top[2] and ((local >= bottom) & (local < top)).all(axis=1).sum() >= LEAST:
            least, most = _tight(local, bottom, top, eye)
            yield np.array([*least[:2], height]), np.array([*most[:2], min(most[2], end)])


def _tight(local: np.ndarray, low: np.ndarray, high: np.ndarray, eye: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A box around the points in a cell: visible sides are at the points, thickness is added behind them."""
    inside = local[((local >= low) & (local < high)).all(axis=1)]
    least, most = np.quantile(inside, [0.02, 0.98], axis=0)
    thin = most - least < THIN_M
    above = eye > (least + most) / 2
    return np.where(thin & above, most - THIN_M, least), np.where(thin & ~above, least + THIN_M, most)


def _merged(local: np.ndarray, taken: np.ndarray, cell: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Cells with points, joined to boxes: pairs of first and last corner (3,), in cells."""
    if not len(local):
        return []
    cells, count = np.unique(np.floor(local / cell).astype(np.int64), axis=0, return_counts=True)
    cells = cells[count >= LEAST]
    if len(taken) and len(cells):
        from scipy.spatial import cKDTree

        apart, _ = cKDTree(taken).query((cells + 0.5) * cell)
        cells = cells[apart > cell * 0.87 + CLEAR_M]
    if not len(cells):
        return []
    start = cells.min(axis=0)
    grid = np.zeros(cells.max(axis=0) - start + 1, bool)
    grid[tuple((cells - start).T)] = True
    return [(low + start, high + start) for low, high in rectangles(grid)]


def _board(name: str, level: Level, thickness: float, room: Room) -> SupportBox:
    """A box below a level surface."""
    centre = np.array([*(level.low + level.high) / 2, level.height_m - thickness / 2])
    return _box(name, centre, [*(level.high - level.low) / 2, thickness / 2], room)


def _box(name: str, centre: np.ndarray, half: np.ndarray | list[float], room: Room) -> SupportBox:
    x, y, z = (float(v) for v in centre @ room.axes)
    a, b, c = (float(v) for v in half)
    return SupportBox(name=name, centre=(x, y, z), half_size=(a, b, c), yaw=room.yaw)
