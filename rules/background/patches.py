"""Segmentation of a photograph into smooth surfaces without depth steps."""

from __future__ import annotations

import cv2
import numpy as np

from dextera_build.geometry import cameras, planes, regions

from .corners import met
from .flats import flats
from .layers import coloured_like
from .patch import SUPPORT, Patch
from .steps import smoothed, steps
from .synthesis import membrane

LEAST = 0.0005
"""Smaller surfaces, as a fraction of the picture, are merged with their neighbours."""
FLAT = 0.012
"""Minimum fraction of the picture that a plane, and a surface that goes on far behind removed pixels, covers."""
PIECE = 0.004
"""Minimum fraction of the picture that a connected piece of a plane covers."""
BLUR = 0.003
"""Registration error of depth and colours, as a fraction of the picture's width."""
GAP = 0.13
"""Maximum distance of an unmeasured pixel that a surface covers from a measured one, as a fraction of the width."""
BROAD = 0.02
"""Minimum fraction of the picture that a broad plane covers."""
STRANGE = 90.0
"""Colour distance from the support, of 255, at which an unmeasured neighbour of it is something else."""
MARGIN = 8
"""Width of the margin of a surface in which its depth is known, too [px]."""


def divide(
    pixels: np.ndarray,
    depth: np.ndarray,
    k: np.ndarray,
    support: np.ndarray,
    plane: planes.Plane,
    taken: np.ndarray,
    beyond: np.ndarray,
    step_m: float,
) -> tuple[np.ndarray, list[Patch]]:
    """Surfaces of the empty scene: labels (H, W) int32, and a patch for each label, the support first.

    Unmeasured pixels go to a neighbouring surface, along the picture's edges; removed ones of which nothing tells the
    surface to the support, if it may go on there, or to the nearest other large one.

    Args:
        pixels: (H, W, 3) uint8 photograph without objects.
        depth: (H, W) [m]; 0 if unknown or removed.
        k: (3, 3) intrinsics [px].
        support: (H, W) pixels of the support.
        plane: The support's plane in the camera frame.
        taken: (H, W) removed pixels.
        beyond: (H, W) those at which the support may go on.
        step_m: Maximum depth difference where surfaces join [m].
    """
    soft = np.where(support, 0.0, smoothed(depth)).astype(np.float32)
    points = cameras.backproject(soft, k)
    up = plane[0] if plane[1] > 0 else -plane[0]
    labels = np.where(support, SUPPORT, 0).astype(np.int32)
    found: dict[int, planes.Plane | None] = {SUPPORT: plane}
    for flat, inside in flats(points, soft > 0, up, FLAT):
        # A plane that is neither vertical nor level may cut through several objects: only large pieces are surfaces.
        level = max(abs(flat[0] @ up), 1.0 - abs(flat[0] @ up)) > 0.99
        for mask in _pieces(inside, (PIECE if level else 2 * PIECE) * labels.size):
            found[len(found) + 1] = flat
            labels[mask] = len(found)
    curved, count = regions.connected((soft > 0) & (labels == 0), *steps(soft, step_m))
    sizes = np.bincount(curved.reshape(-1), minlength=count + 1)
    for number in np.flatnonzero(sizes[1:] >= LEAST * labels.size) + 1:
        found[len(found) + 1] = None
        labels[curved == number] = len(found)
    measured = labels.copy()
    depths = np.where(support, _plane_depth(plane, k, labels.shape), soft)
    labels = _grown(pixels, np.where(_doubtful(labels, depths, step_m), 0, labels).astype(np.int32))
    broad = [n for n, flat in found.items() if flat is not None and (measured == n).sum() >= BROAD * measured.size]
    walls = np.isin(measured, [n for n in broad if n != SUPPORT])
    labels = _without_void(labels, measured, walls)
    # The support is continued where its colours match; a floor without depth has another colour.
    strange = (labels == SUPPORT) & (measured != SUPPORT) & ~coloured_like(pixels, measured == SUPPORT, STRANGE)
    labels = np.where(strange & (_away(measured == SUPPORT) > 2 * BLUR), 0, labels).astype(np.int32)
    labels = np.where(beyond & (labels == 0), SUPPORT, labels).astype(np.int32)
    large = np.isin(measured, [n for n in found if n != SUPPORT and (measured == n).sum() >= FLAT * measured.size])
    if large.any():
        labels = np.where(taken & (labels == 0), nearest(measured, large), labels).astype(np.int32)
    labels = met(labels, taken, measured, points, found, k)
    return labels, [_patch(number, flat, labels, measured, soft) for number, flat in found.items()]


def _plane_depth(plane: planes.Plane, k: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    columns, rows = np.meshgrid(np.arange(shape[1], dtype=np.float64), np.arange(shape[0], dtype=np.float64))
    depth = Patch(SUPPORT, plane).depth(np.stack([columns, rows], axis=-1), k)
    return np.where(np.isfinite(depth), depth, 0.0).astype(np.float32)


def _pieces(mask: np.ndarray, least: float) -> list[np.ndarray]:
    count, labels, facts, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    return [labels == number for number in range(1, count) if facts[number, cv2.CC_STAT_AREA] >= least]


def _doubtful(labels: np.ndarray, soft: np.ndarray, step_m: float) -> np.ndarray:
    """Pixels (H, W) next to a step between two surfaces: depth and colours are registered to a few pixels only."""
    size = max(0, round(BLUR * labels.shape[1]))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * size + 1, 2 * size + 1))
    known = labels > 0
    near = cv2.erode(np.where(known, soft, 99.0).astype(np.float32), np.ones((3, 3), np.uint8))
    far = cv2.dilate(np.where(known, soft, 0.0).astype(np.float32), np.ones((3, 3), np.uint8))
    other = cv2.morphologyEx(labels.astype(np.float32), cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0
    border = (other & (far - near > step_m)).astype(np.uint8)
    inner = cv2.dilate(border, disc) > 0
    # Surfaces too thin to have an inside keep their pixels.
    count = int(labels.max()) + 1
    left = np.bincount(labels[~inner], minlength=count) / np.maximum(np.bincount(labels.reshape(-1)), 1)
    return np.asarray(inner & (left > 0.4)[labels])


def _grown(pixels: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Labels for all pixels: watershed of the picture from the known ones."""
    if (labels > 0).all() or not (labels > 0).any():
        return labels
    wide = cv2.copyMakeBorder(pixels, 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    markers = np.pad(labels, 1)
    cv2.watershed(np.ascontiguousarray(wide), markers)
    grown = np.maximum(markers[1:-1, 1:-1], 0)
    # Watershed lines between two basins are assigned to a neighbour.
    while (grown == 0).any():
        largest = cv2.dilate(grown.astype(np.float32), np.ones((3, 3), np.uint8)).astype(np.int32)
        grown = np.where(grown == 0, largest, grown)
    return np.where(labels > 0, labels, grown).astype(np.int32)


def _away(mask: np.ndarray) -> np.ndarray:
    """Distance of each pixel from a mask, as a fraction of the picture's width."""
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 3) / mask.shape[1])


def _without_void(labels: np.ndarray, measured: np.ndarray, walls: np.ndarray) -> np.ndarray:
    """Labels without wide unmeasured regions, whose surface is unknown.

    Regions wider than the adjacent surface are assigned to a broad plane nearby, whose pixels are `walls` (H, W), such
    as a screen to its wall.
    """
    away = _away(measured > 0)
    core = away > GAP
    wide = _away(core) <= GAP if core.any() else core
    border = cv2.morphologyEx(measured.astype(np.float32), cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0
    inner = cv2.distanceTransform((~border).astype(np.uint8), cv2.DIST_L2, 3) / labels.shape[1]
    radius = np.zeros(int(max(labels.max(), measured.max())) + 1)
    np.maximum.at(radius, measured.reshape(-1), inner.reshape(-1))
    # The distance from the border to the middle is half the surface's width.
    far = (away > 2 * radius[labels]) & (labels != SUPPORT)
    if not walls.any():
        return np.where((wide | far) & (away > 2 * BLUR), 0, labels).astype(np.int32)
    wall = np.where(_away(walls) <= GAP, nearest(measured, walls), 0)
    return np.where(away <= 2 * BLUR, labels, np.where(wide, 0, np.where(far, wall, labels))).astype(np.int32)


def nearest(labels: np.ndarray, where: np.ndarray) -> np.ndarray:
    """The label (H, W) of the nearest pixel of `where` (H, W)."""
    _, nearest = cv2.distanceTransformWithLabels(
        (~where).astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
    )
    owner = np.zeros(int(nearest.max()) + 1, np.int32)
    owner[nearest[where]] = labels[where]
    return np.asarray(owner[nearest])


def _patch(
    number: int, plane: planes.Plane | None, labels: np.ndarray, measured: np.ndarray, soft: np.ndarray
) -> Patch:
    if plane is not None:
        return Patch(number, plane)
    rows, columns = np.nonzero(labels == number)
    top, left = max(0, int(rows.min()) - MARGIN), max(0, int(columns.min()) - MARGIN)
    area = np.s_[top : int(rows.max()) + MARGIN + 1, left : int(columns.max()) + MARGIN + 1]
    known = measured[area] == number
    # Depth directly at the border mixes two surfaces.
    inner = cv2.erode(known.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=1) > 0
    known = inner if inner.sum() > 0.3 * known.sum() else known
    inverse = np.where(known, 1.0 / np.maximum(soft[area], 1e-3), 0.0).astype(np.float32)[..., None]
    return Patch(number, None, (top, left), membrane(inverse, known)[..., 0])
