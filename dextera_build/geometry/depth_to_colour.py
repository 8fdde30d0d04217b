"""Reprojection of a depth image to the picture of another camera."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dextera_build.geometry import cameras, transforms

WIDEST = 6
"""Largest side of the area that a depth pixel covers in the other picture [px]; larger ones leave holes."""


def registered(
    depth: np.ndarray,
    matrix: np.ndarray,
    motion: np.ndarray,
    project: Callable[[np.ndarray], np.ndarray],
    size: tuple[int, int],
) -> np.ndarray:
    """Depth (H, W) float32 [m] in the picture of the other camera, 0 where nothing was measured.

    Each depth pixel is a patch at its depth, and covers the area between its corners in the other picture; the nearest
    patch wins.

    Args:
        depth: (h, w) image-plane z [m], 0 if not measured.
        matrix: (3, 3) intrinsics of the depth camera [px].
        motion: (4, 4) T_other_depth [m].
        project: Points (N, 3) in the other camera's frame -> pixels (N, 2), integer pixel centres.
        size: Width and height of the other picture [px].
    """
    rows, columns = np.nonzero(depth > 0)
    z = depth[rows, columns].astype(np.float64)
    rays = cameras.rays(depth.shape[0], depth.shape[1], matrix)[rows, columns]
    half = np.array([0.5 / matrix[0, 0], 0.5 / matrix[1, 1], 0.0])
    middle = transforms.apply(motion, rays * z[:, None])
    corners = [project(transforms.apply(motion, (rays + side * half) * z[:, None])) for side in (-1.0, 1.0)]
    known = (middle[:, 2] > 0) & np.isfinite(corners[0]).all(axis=1) & np.isfinite(corners[1]).all(axis=1)
    low = np.ceil(np.minimum(*corners)[known] - 0.5 + 1e-9).astype(np.int64)
    high = np.floor(np.maximum(*corners)[known] + 0.5 - 1e-9).astype(np.int64)
    found = np.full((size[1], size[0]), np.inf)
    reach = np.minimum(high - low, WIDEST)
    for down in range(int(reach[:, 1].max(initial=0)) + 1):
        for across in range(int(reach[:, 0].max(initial=0)) + 1):
            covers = (reach[:, 0] >= across) & (reach[:, 1] >= down)
            column, row = (low[covers] + [across, down]).T
            inside = (column >= 0) & (column < size[0]) & (row >= 0) & (row < size[1])
            np.minimum.at(found, (row[inside], column[inside]), middle[known][covers][inside, 2])
    return np.where(np.isfinite(found), found, 0.0).astype(np.float32)
