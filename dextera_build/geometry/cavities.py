"""The cavity of an upright container: the volume that rain would fill before it overflows."""

from __future__ import annotations

import heapq

import numpy as np

from dextera_build.geometry import metrics

CELLS = 48
"""Columns along the longest horizontal edge."""
SAMPLES = 40
"""Surface samples per column of a flat floor, so that no column is empty."""
MOST = 400_000
"""Maximum number of samples."""
SHALLOW_M = 0.008
"""Minimum depth of a cavity [m]."""


def find(vertices: np.ndarray, faces: np.ndarray) -> tuple[tuple[float, float], float, np.ndarray, np.ndarray] | None:
    """The cavity of a surface, as columns of a horizontal grid.

    The height map seen from above is flooded from the border (priority flood); its lakes are the cavity. Holes in a
    wall, spouts and notches therefore limit the cavity to the level at which water would run out.

    Args:
        vertices: (V, 3) [m], z up.
        faces: (F, 3).

    Returns:
        Corner (x, y) of the grid and edge of a column [m]; height of the floor and of the rim of every column (X, Y)
        [m], equal outside the cavity. None without a cavity.
    """
    low, high = vertices.min(axis=0).astype(np.float64), vertices.max(axis=0).astype(np.float64)
    cell = float((high - low)[:2].max()) / CELLS
    corner = low[:2] - cell
    shape = tuple((np.ceil((high - low)[:2] / cell).astype(int) + 3).tolist())
    corners = vertices[faces].astype(np.float64)
    area = (
        float(np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()) / 2
    )
    points = metrics.sample_surface(vertices, faces, int(min(MOST, SAMPLES * area / cell**2)), seed=0)
    floor = np.full(shape, low[2])
    row, column = ((points[:, :2] - corner) / cell).astype(int).T
    np.maximum.at(floor, (row, column), points[:, 2])
    rim = _flooded(floor)
    rooms = rim - floor > SHALLOW_M
    if not rooms.any():
        return None
    x, y = corner.tolist()
    return (x, y), cell, floor, np.where(rooms, rim, floor)


def _flooded(heights: np.ndarray) -> np.ndarray:
    """Water level in every cell, (X, Y): the lowest pass on the best path to the border."""
    water = np.full(heights.shape, np.inf)
    queue: list[tuple[float, int, int]] = []
    for row, column in np.ndindex(*heights.shape):
        if row in (0, heights.shape[0] - 1) or column in (0, heights.shape[1] - 1):
            water[row, column] = heights[row, column]
            heapq.heappush(queue, (float(heights[row, column]), row, column))
    while queue:
        level, row, column = heapq.heappop(queue)
        for down, right in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            there = row + down, column + right
            inside = 0 <= there[0] < heights.shape[0] and 0 <= there[1] < heights.shape[1]
            if inside and np.isinf(water[there]):
                water[there] = max(level, float(heights[there]))
                heapq.heappush(queue, (float(water[there]), *there))
    return water
