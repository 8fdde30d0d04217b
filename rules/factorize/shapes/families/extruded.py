"""Prisms: the footprint swept upwards, for flat objects with a fully visible top."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import solids
from dextera_build.geometry.solids import Solid

from ..evidence import Evidence
from ..refine import Model
from .box import LARGEST_M, SMALLEST_M, upright

CELL_M = 0.003
"""Grid on which the footprint is rasterized [m]."""
SLACK_M = 0.0025
"""Tolerance of the outline's simplification [m]."""


def extruded(evidence: Evidence) -> tuple[np.ndarray, Model] | None:
    """The outline (P, 2) about its centre, and a model: x, y, growth in x and y, height of the prism."""
    top = evidence.points[evidence.normals[:, 2] > 0.7]
    flat = len(top) > 0.4 * len(evidence.points)
    outline = footprint(top if flat else evidence.points, closed=not flat)
    if outline is None:
        return None
    middle = (outline.min(axis=0) + outline.max(axis=0)) / 2
    centred = outline - middle
    start = np.array([*middle, 1.0, 1.0, evidence.height])
    size = max(float(np.ptp(outline, axis=0).max()), 0.01)
    model = Model(
        name="extruded",
        build=lambda p: body(centred, p).moved(upright(p[0], p[1], 0.0)),
        starts=[start],
        steps=np.array([0.003, 0.003, 0.003 / size, 0.003 / size, 0.003]),
        lower=np.array([-np.inf, -np.inf, 0.6, 0.6, SMALLEST_M]),
        upper=np.array([np.inf, np.inf, 1.6, 1.6, LARGEST_M]),
        cost=0.03,
    )
    return centred, model


def body(outline: np.ndarray, p: np.ndarray) -> Solid:
    """The prism in its own frame, base on z = 0."""
    return solids.extrude(outline * p[2:4], 0.0, float(p[4]))


def footprint(points: np.ndarray, *, closed: bool) -> np.ndarray | None:
    """Outline (P, 2) of points (N, 3) seen from above, counter-clockwise; `closed` takes their convex hull."""
    import cv2
    from scipy import ndimage

    if len(points) < 20:
        return None
    low = points[:, :2].min(axis=0) - 4 * CELL_M
    cells = np.floor((points[:, :2] - low) / CELL_M).astype(int)
    size = cells.max(axis=0) + 5
    if size.max() > 700:
        return None
    count = np.zeros(size[::-1], np.int32)
    np.add.at(count, (cells[:, 1], cells[:, 0]), 1)
    filled = ndimage.binary_closing(count > 0, iterations=3)
    filled = ndimage.binary_opening(ndimage.binary_fill_holes(filled), iterations=1)
    contours, _ = cv2.findContours(filled.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return None
    contour = max(contours, key=cv2.contourArea)
    contour = cv2.convexHull(contour) if closed else cv2.approxPolyDP(contour, SLACK_M / CELL_M, True)
    outline = (contour[:, 0].astype(np.float64) + 0.5) * CELL_M + low
    if len(outline) < 3:
        return None
    following = np.roll(outline, -1, axis=0)
    turning = (outline[:, 0] * following[:, 1] - outline[:, 1] * following[:, 0]).sum()
    return np.asarray(outline if turning > 0 else outline[::-1].copy())
