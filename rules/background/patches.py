"""Divide a photograph into smooth surfaces, none of which joins things apart in depth."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from dextera_build.geometry import cameras, planes

from .flats import flats
from .layers import coloured_like
from .steps import connected, smoothed, steps
from .synthesis import membrane

SUPPORT = 1
"""Label of the support."""
LEAST = 0.0005
"""Smaller surfaces, as a fraction of the picture, belong to their neighbours."""
FLAT = 0.012
"""Least fraction of the picture that a plane covers."""
PIECE = 0.004
"""Least fraction of the picture that a connected piece of a plane covers."""
BLUR = 0.003
"""Depth and colours are registered to this fraction of the picture's width."""
GAP = 0.13
"""Surfaces go on over unmeasured places that are nowhere farther from a measured pixel, as a fraction of the width."""
BROAD = 0.02
"""Least fraction of the picture that a broad plane covers."""
STRANGE = 90.0
"""Colour distance from the support, of 255, at which an unmeasured neighbour of it is something else."""
JOINED_M = 0.03
"""Corners of a face on a curved surface are at most this far apart in depth [m]."""
DIVISIONS = 3
"""Times that the edges of a steep face are halved."""
MARGIN = 8
"""Pixels around a surface for which its depth is known, too."""


@dataclass(frozen=True)
class Patch:
    """One smooth surface."""

    number: int
    """Its label."""
    plane: planes.Plane | None
    """In the camera frame; None for a curved surface."""
    corner: tuple[int, int] = (0, 0)
    """First row and column of `inverse`."""
    inverse: np.ndarray | None = None
    """(h, w) float32, 1 / depth of a curved surface and its surroundings [1/m]."""

    def depth(self, pixel: np.ndarray, k: np.ndarray) -> np.ndarray:
        """Depth (...) [m] at pixels (..., 2), column and row, in or out of the picture; infinite where it has none."""
        if self.plane is None:
            assert self.inverse is not None
            return np.asarray(1.0 / _sampled(self.inverse, pixel - self.corner[::-1]))
        normal, offset = self.plane
        ray = [(pixel[..., 0] - k[0, 2]) / k[0, 0], (pixel[..., 1] - k[1, 2]) / k[1, 1]]
        down = -(ray[0] * normal[0] + ray[1] * normal[1] + normal[2])
        with np.errstate(divide="ignore"):
            depth = offset / down
        return np.where((down > 1e-6) & (depth > 0), depth, np.inf)

    def fine(
        self, pixel: np.ndarray, faces: np.ndarray, k: np.ndarray, push: float = 1.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Corners (V, 2) and faces (F, 3) of a triangulation in the picture that joins nothing apart.

        A face in a plane joins nothing. Of a curved surface, steep faces are divided; what is still steep when it is
        smaller than a pixel is a step. `push` is a factor of all depths.
        """
        if self.plane is not None:
            return pixel, faces
        for _ in range(DIVISIONS):
            steep = np.ptp(self.depth(pixel, k)[faces], axis=1) > JOINED_M / push
            a, b, c = (faces[steep][:, corner] for corner in range(3))
            middles = np.concatenate([(pixel[i] + pixel[j]) / 2 for i, j in ((a, b), (b, c), (c, a))])
            ab, bc, ca = np.split(len(pixel) + np.arange(len(middles)), 3)
            quarters = [np.stack(each, axis=1) for each in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
            pixel, faces = np.concatenate([pixel, middles]), np.concatenate([faces[~steep], *quarters])
        return pixel, faces[np.ptp(self.depth(pixel, k)[faces], axis=1) <= JOINED_M / push]


def _sampled(values: np.ndarray, pixel: np.ndarray) -> np.ndarray:
    """`values` (h, w) between their pixels, at (..., 2) column and row; those of the border beyond it."""
    place = np.clip(pixel, 0, [values.shape[1] - 1, values.shape[0] - 1])
    first = np.minimum(place.astype(np.int64), [max(0, values.shape[1] - 2), max(0, values.shape[0] - 2)])
    column, row = first[..., 0], first[..., 1]
    right, below = np.minimum(column + 1, values.shape[1] - 1), np.minimum(row + 1, values.shape[0] - 1)
    u, v = (place - first)[..., 0], (place - first)[..., 1]
    upper = values[row, column] * (1 - u) + values[row, right] * u
    return np.asarray(upper * (1 - v) + (values[below, column] * (1 - u) + values[below, right] * u) * v)


def divide(
    pixels: np.ndarray,
    depth: np.ndarray,
    k: np.ndarray,
    support: np.ndarray,
    plane: planes.Plane,
    step_m: float,
) -> tuple[np.ndarray, list[Patch]]:
    """Surfaces of the empty scene: labels (H, W) int32, and a patch for each label, the support first.

    Unmeasured pixels go to a neighbouring surface, along the picture's edges.

    Args:
        pixels: (H, W, 3) uint8 photograph without objects.
        depth: (H, W) [m]; 0 if unknown, or if something was taken out.
        k: (3, 3) intrinsics [px].
        support: (H, W) pixels of the support.
        plane: The support's plane in the camera frame.
        step_m: Surfaces are at most this far apart where they join [m].
    """
    soft = np.where(support, 0.0, smoothed(depth)).astype(np.float32)
    points = cameras.backproject(soft, k)
    up = plane[0] if plane[1] > 0 else -plane[0]
    labels = np.where(support, SUPPORT, 0).astype(np.int32)
    found: dict[int, planes.Plane | None] = {SUPPORT: plane}
    for flat, inside in flats(points, soft > 0, up, FLAT):
        # A plane that is neither upright nor level may cut through several things: only large pieces are surfaces.
        level = max(abs(flat[0] @ up), 1.0 - abs(flat[0] @ up)) > 0.99
        for mask in _pieces(inside, (PIECE if level else 2 * PIECE) * labels.size):
            found[len(found) + 1] = flat
            labels[mask] = len(found)
    curved, count = connected((soft > 0) & (labels == 0), *steps(soft, step_m))
    sizes = np.bincount(curved.reshape(-1), minlength=count + 1)
    for number in np.flatnonzero(sizes[1:] >= LEAST * labels.size) + 1:
        found[len(found) + 1] = None
        labels[curved == number] = len(found)
    measured = labels.copy()
    depths = np.where(support, _plane_depth(plane, k, labels.shape), soft)
    labels = _grown(pixels, np.where(_doubtful(labels, depths, step_m), 0, labels).astype(np.int32))
    broad = [n for n, flat in found.items() if flat is not None and (measured == n).sum() >= BROAD * measured.size]
    labels = _without_void(labels, measured, [n for n in broad if n != SUPPORT])
    # The support goes on where it looks as it does; a floor without depth has another colour.
    strange = (labels == SUPPORT) & (measured != SUPPORT) & ~coloured_like(pixels, measured == SUPPORT, STRANGE)
    labels = np.where(strange & (_away(measured == SUPPORT) > 2 * BLUR), 0, labels).astype(np.int32)
    return labels, [_patch(number, flat, labels, measured, soft) for number, flat in found.items()]


def _plane_depth(plane: planes.Plane, k: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    columns, rows = np.meshgrid(np.arange(shape[1], dtype=np.float64), np.arange(shape[0], dtype=np.float64))
    depth = Patch(SUPPORT, plane).depth(np.stack([columns, rows], axis=-1), k)
    return np.where(np.isfinite(depth), depth, 0.0).astype(np.float32)


def _pieces(mask: np.ndarray, least: float) -> list[np.ndarray]:
    count, labels, facts, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    return [labels == number for number in range(1, count) if facts[number, cv2.CC_STAT_AREA] >= least]


def _doubtful(labels: np.ndarray, soft: np.ndarray, step_m: float) -> np.ndarray:
    """Pixels (H, W) beside a step between two surfaces: depth and colours are registered to a few pixels only."""
    size = max(0, round(BLUR * labels.shape[1]))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * size + 1, 2 * size + 1))
    known = labels > 0
    near = cv2.erode(np.where(known, soft, 99.0).astype(np.float32), np.ones((3, 3), np.uint8))
    far = cv2.dilate(np.where(known, soft, 0.0).astype(np.float32), np.ones((3, 3), np.uint8))
    other = cv2.morphologyEx(labels.astype(np.float32), cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0
    border = (other & (far - near > step_m)).astype(np.uint8)
    inner = cv2.dilate(border, disc) > 0
    # What is too thin to have an inside keeps its pixels.
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
    # The lines between two basins are nobody's: they go to a neighbour.
    while (grown == 0).any():
        largest = cv2.dilate(grown.astype(np.float32), np.ones((3, 3), np.uint8)).astype(np.int32)
        grown = np.where(grown == 0, largest, grown)
    return np.where(labels > 0, labels, grown).astype(np.int32)


def _away(mask: np.ndarray) -> np.ndarray:
    """Distance of each pixel from a mask, as a fraction of the picture's width."""
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 3) / mask.shape[1])


def _without_void(labels: np.ndarray, measured: np.ndarray, broad: list[int]) -> np.ndarray:
    """Labels without wide unmeasured places: nobody knows them.

    Those that are wider than the surface beside them go to a broad plane nearby, such as a screen to its wall.
    """
    away = _away(measured > 0)
    core = away > GAP
    wide = _away(core) <= GAP if core.any() else core
    border = cv2.morphologyEx(measured.astype(np.float32), cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0
    inner = cv2.distanceTransform((~border).astype(np.uint8), cv2.DIST_L2, 3) / labels.shape[1]
    radius = np.zeros(int(max(labels.max(), measured.max())) + 1)
    np.maximum.at(radius, measured.reshape(-1), inner.reshape(-1))
    # Half a surface's width lies between its border and its middle.
    far = (away > 2 * radius[labels]) & (labels != SUPPORT)
    walls = np.isin(measured, broad)
    if not walls.any():
        return np.where((wide | far) & (away > 2 * BLUR), 0, labels).astype(np.int32)
    _, nearest = cv2.distanceTransformWithLabels(
        (~walls).astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
    )
    owner = np.zeros(int(nearest.max()) + 1, np.int32)
    owner[nearest[walls]] = measured[walls]
    wall = np.where(_away(walls) <= GAP, owner[nearest], 0)
    return np.where(away <= 2 * BLUR, labels, np.where(wide, 0, np.where(far, wall, labels))).astype(np.int32)


def _patch(
    number: int, plane: planes.Plane | None, labels: np.ndarray, measured: np.ndarray, soft: np.ndarray
) -> Patch:
    if plane is not None:
        return Patch(number, plane)
    rows, columns = np.nonzero(labels == number)
    top, left = max(0, int(rows.min()) - MARGIN), max(0, int(columns.min()) - MARGIN)
    area = np.s_[top : int(rows.max()) + MARGIN + 1, left : int(columns.max()) + MARGIN + 1]
    known = measured[area] == number
    # Depth at the very border mixes two surfaces.
    inner = cv2.erode(known.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=1) > 0
    known = inner if inner.sum() > 0.3 * known.sum() else known
    inverse = np.where(known, 1.0 / np.maximum(soft[area], 1e-3), 0.0).astype(np.float32)[..., None]
    return Patch(number, None, (top, left), membrane(inverse, known)[..., 0])
