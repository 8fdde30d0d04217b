"""Continue surfaces behind what hides them, and beyond the picture's border."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from .cutting import cut
from .patches import SUPPORT, Patch
from .pieces import Piece
from .scenery import Scenery
from .shell import Room
from .synthesis import membrane

HALF = 2
"""Photograph pixels per pixel of the wider picture."""
BESIDE = 0.5
"""Border of the wider picture, as a fraction of the photograph's size."""
LARGE = 0.02
"""Planes that cover this fraction of the photograph go on as far as the room does."""
NEAR = 0.06
"""Other surfaces go on this far, as a fraction of the photograph's width, and not beyond its border."""
BEHIND_M = 0.02
"""A surface goes on only where it is at least this far behind what was seen [m]."""
PUSH = 1.0015
"""Relative distance behind the photographed surface where both overlap."""
OVERLAP_PX = 3
"""Overlap with the photographed part [pixels of the wider picture]."""


@dataclass(frozen=True)
class _Wide:
    """The wider picture: pixel centres in the photograph, and what the photograph shows there."""

    pixel: np.ndarray  # (h, w, 2) column and row in the photograph
    inside: np.ndarray  # (h, w) bool, within the photograph
    labels: np.ndarray  # (h, w) int32; 0 outside
    depth: np.ndarray  # (h, w) [m]; 0 outside
    colour: np.ndarray  # (h, w, 3) float32


def continued(scenery: Scenery, room: Room, stride: float) -> list[Piece]:
    """Surfaces behind and beside what was seen; `stride` is the spacing of their vertices [photograph pixels]."""
    wide = _wide(scenery)
    owner, patches = _owners(wide, scenery, room)
    picture = np.zeros((*owner.shape, 3), np.float32)
    masks = {}
    for patch in patches:
        mask = owner == patch.number
        if mask.sum() >= 30:
            masks[patch.number] = mask
            _paint(picture, mask, wide, patch.number)
    picture = np.where((owner > 0)[..., None], picture, wide.colour)
    shown = np.clip(picture, 0, 255).astype(np.uint8)
    pieces = []
    kernel = np.ones((2 * OVERLAP_PX + 1, 2 * OVERLAP_PX + 1), np.uint8)
    for patch in patches:
        if patch.number in masks:
            mask = masks[patch.number]
            grown = cv2.dilate(mask.astype(np.uint8), kernel) > 0
            seam = grown & (wide.labels == patch.number)
            piece = _piece(patch, mask | seam, wide, scenery, room, stride, shown)
            if len(piece.faces):
                pieces.append(piece)
    return pieces


def _wide(scenery: Scenery) -> _Wide:
    height, width = scenery.labels.shape
    down, right = (round(BESIDE * n / HALF) for n in (height, width))
    rows = (np.arange(-down, height // HALF + down) + 0.5) * HALF - 0.5
    columns = (np.arange(-right, width // HALF + right) + 0.5) * HALF - 0.5
    pixel = np.stack(np.meshgrid(columns, rows), axis=-1)
    inside = (pixel > -0.5).all(axis=-1) & (pixel[..., 0] < width - 0.5) & (pixel[..., 1] < height - 0.5)
    row = np.clip(np.round(pixel[..., 1]), 0, height - 1).astype(int)
    column = np.clip(np.round(pixel[..., 0]), 0, width - 1).astype(int)
    small = cv2.blur(scenery.pixels, (HALF + 1, HALF + 1)).astype(np.float32)
    labels = np.where(inside, scenery.labels[row, column], 0).astype(np.int32)
    return _Wide(pixel, inside, labels, np.where(inside, scenery.depth[row, column], 0.0), small[row, column])


def _owners(wide: _Wide, scenery: Scenery, room: Room) -> tuple[np.ndarray, list[Patch]]:
    """Which surface goes on at each pixel of the wider picture, (h, w) int32; 0 none."""
    best = np.full(wide.labels.shape, np.inf, np.float32)
    owner = np.zeros(wide.labels.shape, np.int32)
    patches = [p for p in scenery.patches if p.number != SUPPORT and (wide.labels == p.number).any()]
    for patch in patches:
        own = wide.labels == patch.number
        large = patch.plane is not None and own.sum() >= LARGE * wide.inside.sum()
        away = cv2.distanceTransform((~own).astype(np.uint8), cv2.DIST_L2, 3)
        free = ~own & (away < best)
        if not large:
            free &= wide.inside & (away < NEAR * scenery.labels.shape[1] / HALF)
        where = np.nonzero(free)
        depth = patch.depth(wide.pixel[where], scenery.k)
        good = np.isfinite(depth) & (depth > wide.depth[where] + BEHIND_M)
        good[good] = room.holds(scenery.lift(wide.pixel[where][good], depth[good]))
        free[where] = good
        free = _touching(free, own)
        best[free], owner[free] = away[free], patch.number
    return owner, patches


def _touching(free: np.ndarray, own: np.ndarray) -> np.ndarray:
    """The parts of `free` that are connected with `own`."""
    _, labels = cv2.connectedComponents((free | own).astype(np.uint8), connectivity=4)
    kept = np.zeros(labels.max() + 1, bool)
    kept[labels[own]] = True
    return np.asarray(free & kept[labels])


def _paint(picture: np.ndarray, mask: np.ndarray, wide: _Wide, number: int) -> None:
    """Continue a surface's colours over its hidden part."""
    own = (wide.labels == number).astype(np.uint8)
    inner = cv2.erode(own, np.ones((3, 3), np.uint8)) > 0
    known = inner if inner.any() else own > 0
    rows, columns = np.nonzero(mask | (own > 0))
    area = np.s_[int(rows.min()) : int(rows.max()) + 1, int(columns.min()) : int(columns.max()) + 1]
    colour = np.where(known[area][..., None], wide.colour[area], 0.0).astype(np.float32)
    found = membrane(colour, known[area])
    picture[area] = np.where((mask | (own > 0))[area][..., None], found, picture[area])


def _piece(
    patch: Patch, mask: np.ndarray, wide: _Wide, scenery: Scenery, room: Room, stride: float, picture: np.ndarray
) -> Piece:
    points, faces = cut(mask, max(2.0, stride / HALF), 3.0)
    origin = wide.pixel[0, 0]
    pixel = origin + points * HALF
    depth = patch.depth(pixel, scenery.k)
    # The outline may run a little over the end of a plane that is seen edge on.
    good = np.isfinite(depth)
    good[good] = room.holds(scenery.lift(pixel[good], depth[good]), 0.05)
    faces = faces[good[faces].all(axis=1)]
    vertices = scenery.lift(pixel, np.where(good, depth, 1.0) * PUSH)
    return Piece(vertices, faces, points, picture)
