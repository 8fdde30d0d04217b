"""Triangulation of a mask in the picture with a smoothed outline."""

from __future__ import annotations

import cv2
import numpy as np

SOFT = 9
"""Length over which an outline is averaged, in half pixels."""
FINE = 4
"""Raster cells per pixel with which triangles are tested."""


def cut(mask: np.ndarray, stride: float, spacing: float, rim: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Triangulate a mask.

    Args:
        mask: (H, W) pixels.
        stride: Spacing of inner vertices [px].
        spacing: Spacing of vertices on the outline [px].
        rim: Extension of the mask beyond the picture's border [px].

    Returns:
        Vertices (N, 2), column and row [px], and faces (F, 3), counter-clockwise for the camera.
    """
    from scipy.spatial import Delaunay, QhullError

    nothing = np.zeros((0, 2)), np.zeros((0, 3), np.int64)
    if not mask.any():
        return nothing
    wide = np.pad(np.pad(mask, rim, mode="edge"), 1).astype(np.uint8)
    outlines = _outlines(wide, spacing)
    if not outlines:
        return nothing
    # Outlines are drawn in a finer raster: OpenCV takes fixed-point coordinates.
    fine = np.zeros((wide.shape[0] * FINE, wide.shape[1] * FINE), np.uint8)
    cv2.fillPoly(fine, [np.round((line + 0.5) * FINE - 0.5).astype(np.int32) for line in outlines], 1)
    away = cv2.distanceTransform(wide, cv2.DIST_L2, 3)
    rows, columns = (np.arange(stride / 2, n, stride) for n in wide.shape)
    grid = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    deep = away[grid[:, 1].astype(int), grid[:, 0].astype(int)] > 0.7 * spacing + 1.0
    points = np.concatenate([*outlines, grid[deep]])
    try:
        faces = np.asarray(Delaunay(points).simplices, np.int64)
    except QhullError:
        return nothing
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    middle = ((a + b + c) / 3 + 0.5) * FINE - 0.5
    turn = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    inside = fine[np.round(middle[:, 1]).astype(int), np.round(middle[:, 0]).astype(int)] > 0
    faces, turn = faces[inside & (np.abs(turn) > 1e-3)], turn[inside & (np.abs(turn) > 1e-3)]
    # Image rows increase downwards.
    faces = np.where((turn > 0)[:, None], faces[:, ::-1], faces)
    used, faces = np.unique(faces, return_inverse=True)
    return points[used] - (rim + 1), faces.reshape(-1, 3)


def _outlines(wide: np.ndarray, spacing: float) -> list[np.ndarray]:
    """Closed outlines (N, 2), column and row, averaged along their length and resampled."""
    # Contours run through the centres of border pixels; in a finer raster they are closer to the pixels' border.
    double = cv2.resize(wide, None, fx=2, fy=2, interpolation=cv2.INTER_NEAREST)
    found, _ = cv2.findContours(double, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    lines = []
    for contour in found:
        line = contour[:, 0] / 2 - 0.25
        if len(line) < 2 * SOFT:
            continue
        around = np.concatenate([line[-(SOFT // 2) :], line, line[: SOFT // 2]])
        soft = np.stack([np.convolve(around[:, axis], np.ones(SOFT) / SOFT, "valid") for axis in (0, 1)], axis=1)
        count = max(6, round(len(soft) / 2 / spacing))
        lines.append(soft[np.linspace(0, len(soft), count, endpoint=False).astype(int)])
    return lines
