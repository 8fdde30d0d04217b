"""The surfaces that the photograph shows, as triangles with its pixels."""

from __future__ import annotations

import cv2
import numpy as np

from .cutting import cut
from .patches import SUPPORT, Patch
from .pieces import Piece
from .scenery import Scenery

OVER_PX = 2
"""Surfaces reach this far under nearer neighbours, so that no gap opens between them [px]."""
LEVEL_M = 0.012
"""Neighbours within this distance are level with each other [m]."""


def front(scenery: Scenery, stride: float, inside: np.ndarray) -> list[Piece]:
    """One piece for each surface.

    Args:
        scenery: What was seen.
        stride: Spacing of the vertices [px].
        inside: (H, W) pixels whose ray meets the support inside its outline.
    """
    kernel = np.ones((2 * OVER_PX + 1, 2 * OVER_PX + 1), np.uint8)
    pieces = []
    for patch in scenery.patches:
        own = scenery.labels == patch.number
        if not own.any():
            continue
        if patch.number == SUPPORT:
            own = own & inside
        beside = (cv2.dilate(own.astype(np.uint8), kernel) > 0) & ~own
        row, column = np.nonzero(beside)
        depth = patch.depth(np.stack([column, row], axis=-1).astype(np.float64), scenery.k)
        under = np.isfinite(depth) & (depth > scenery.depth[row, column] - LEVEL_M)
        if patch.number == SUPPORT:
            under &= inside[row, column]
        grown = own.copy()
        grown[row[under], column[under]] = True
        piece = _piece(patch, grown, scenery, stride if patch.plane is None else 2.5 * stride)
        if len(piece.faces):
            pieces.append(piece)
    return pieces


def _piece(patch: Patch, mask: np.ndarray, scenery: Scenery, stride: float) -> Piece:
    pixel, faces = cut(mask, stride, max(3.0, 0.6 * stride), OVER_PX)
    depth = patch.depth(pixel, scenery.k)
    good = np.isfinite(depth)
    faces = faces[good[faces].all(axis=1)]
    return Piece(scenery.lift(pixel, np.where(good, depth, 1.0)), faces, pixel, scenery.pixels)
