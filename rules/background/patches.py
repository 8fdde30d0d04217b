"""Divide a photograph into smooth surfaces, none of which joins things apart in depth."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from dextera_build.geometry import cameras, planes

from .flats import flats
from .steps import connected, smoothed, steps
from .synthesis import membrane

SUPPORT = 1
"""Label of the support."""
LEAST = 0.0005
"""Smaller surfaces, as a fraction of the picture, belong to their neighbours."""
FLAT = 0.012
"""Least fraction of the picture that a plane covers."""
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
            row, column = (pixel[..., 1 - axis] - self.corner[axis] for axis in (0, 1))
            maps = [np.ascontiguousarray(m, np.float32).reshape(-1, 1) for m in (column, row)]
            rows = [
                cv2.remap(self.inverse, *(m[i : i + 30_000] for m in maps), cv2.INTER_LINEAR, borderMode=1)
                for i in range(0, len(maps[0]), 30_000)
            ]
            return np.asarray(1.0 / np.concatenate(rows).reshape(column.shape).astype(np.float64))
        normal, offset = self.plane
        ray = [(pixel[..., 0] - k[0, 2]) / k[0, 0], (pixel[..., 1] - k[1, 2]) / k[1, 1]]
        down = -(ray[0] * normal[0] + ray[1] * normal[1] + normal[2])
        with np.errstate(divide="ignore"):
            depth = offset / down
        return np.where((down > 1e-6) & (depth > 0), depth, np.inf)


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
        for mask in _pieces(inside):
            found[len(found) + 1] = flat
            labels[mask] = len(found)
    curved, count = connected((soft > 0) & (labels == 0), *steps(soft, step_m))
    sizes = np.bincount(curved.reshape(-1), minlength=count + 1)
    for number in np.flatnonzero(sizes[1:] >= LEAST * labels.size) + 1:
        found[len(found) + 1] = None
        labels[curved == number] = len(found)
    measured = labels.copy()
    labels = _grown(pixels, labels)
    return labels, [_patch(number, flat, labels, measured, soft) for number, flat in found.items()]


def _pieces(mask: np.ndarray) -> list[np.ndarray]:
    count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
    return [labels == number for number in range(1, count)]


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
