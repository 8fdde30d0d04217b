"""The visible surfaces as textured triangles."""

from __future__ import annotations

import cv2
import numpy as np

from .cutting import cut
from .patch import SUPPORT, Patch
from .pieces import Piece
from .scenery import Scenery

OVER_PX = 2
"""Surfaces extend this far into neighbours that are not nearer, so that no gap opens between them [px]."""
MIXED_PX = 2
"""Surfaces end this far from where they continue behind something nearer [px]."""
LEVEL_M = 0.012
"""Neighbours within this distance are level with each other [m]."""


def front(scenery: Scenery, stride: float, inside: np.ndarray, behind: np.ndarray) -> list[Piece]:
    """One piece for each surface.

    Args:
        scenery: The visible empty scene.
        stride: Spacing of the vertices [px].
        inside: (H, W) pixels whose ray meets the support inside its outline.
        behind: (H, W) number of the surface that continues behind the visible one at each pixel; 0 none.
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
        apart = np.where(np.isfinite(depth), depth, np.inf) - scenery.depth[row, column]
        level = np.abs(apart) < LEVEL_M
        if patch.number == SUPPORT:
            level &= inside[row, column]
        grown = own.copy()
        grown[row[level], column[level]] = True
        # Pixels next to something nearer mix its colour; the continuation behind it replaces them.
        broad = cv2.morphologyEx((behind == patch.number).astype(np.uint8), cv2.MORPH_OPEN, np.ones((7, 7), np.uint8))
        mixed = cv2.dilate(broad, np.ones((2 * MIXED_PX + 1, 2 * MIXED_PX + 1), np.uint8)) > 0
        grown &= ~mixed
        over = beside & (behind != patch.number) & ~mixed
        over[row[apart < -LEVEL_M], column[apart < -LEVEL_M]] = False
        if patch.number != SUPPORT:
            grown |= over
        piece = _piece(patch, grown, scenery, stride if patch.plane is None else 2.5 * stride)
        if len(piece.faces):
            pieces.append(piece)
    return pieces


def _piece(patch: Patch, mask: np.ndarray, scenery: Scenery, stride: float) -> Piece:
    pixel, faces = cut(mask, stride, max(3.0, 0.6 * stride), OVER_PX)
    pixel, faces = patch.fine(pixel, faces, scenery.k)
    depth = patch.depth(pixel, scenery.k)
    good = np.isfinite(depth)
    faces = faces[good[faces].all(axis=1)]
    return Piece(scenery.lift(pixel, np.where(good, depth, 1.0)), faces, pixel, scenery.pixels)
