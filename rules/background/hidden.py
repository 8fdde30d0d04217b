"""Continuation of surfaces behind occluders and beyond the picture's border."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from .cutting import cut
from .ends import BEHIND_M, border, limits
from .patch import SUPPORT, Patch
from .pieces import Piece
from .scenery import Scenery
from .shell import Room
from .synthesis import membrane

HALF = 2
"""Photograph pixels per pixel of the wider picture."""
BESIDE = 0.5
"""Border of the wider picture, as a fraction of the photograph's size."""
LARGE = 0.02
"""Planes along the room's walls that cover this fraction of the photograph are broad and may extend far."""
ALONG = 0.985
"""Cosine of the largest angle between such a plane and the wall."""
FAR = 1.5
"""Broad planes extend this far, in multiples of the square root of their area, and beyond the photograph's border."""
NEAR = 0.03
"""All surfaces extend this far, as a fraction of the photograph's width."""
FADE = 0.25
"""Distance at which colours have faded to the surface's mean, as a fraction of the wider picture's width."""
PUSH = 1.0015
"""Relative distance behind the photographed surface where both overlap."""
OVERLAP_PX = 3
"""Overlap with the photographed part [pixels of the wider picture]."""


@dataclass(frozen=True)
class _Wide:
    """The wider picture: pixel centres in the photograph, and the photograph's content there."""

    pixel: np.ndarray  # (h, w, 2) column and row in the photograph
    inside: np.ndarray  # (h, w) bool, within the photograph
    labels: np.ndarray  # (h, w) int32; 0 outside
    depth: np.ndarray  # (h, w) [m]; 0 outside
    colour: np.ndarray  # (h, w, 3) float32


def continued(scenery: Scenery, room: Room, stride: float) -> tuple[list[Piece], np.ndarray]:
    """Surfaces behind and next to the visible ones; `stride` is the spacing of their vertices [photograph pixels].

    Returns:
        The pieces, and (H, W) int32: the surface that continues behind each pixel of the photograph; 0 none.
    """
    wide = _wide(scenery)
    broad = [p for p in scenery.patches if p.number != SUPPORT and _broad(p, wide, scenery, room)]
    small = [p for p in scenery.patches if p.number != SUPPORT and p not in broad]
    # Walls continue behind everything, so they are a separate layer.
    far, behind_far = _layer(broad, wide, scenery, room, stride)
    near, behind_near = _layer(small, wide, scenery, room, stride)
    return [*far, *near], np.where(behind_near > 0, behind_near, behind_far)


def _layer(
    patches: list[Patch], wide: _Wide, scenery: Scenery, room: Room, stride: float
) -> tuple[list[Piece], np.ndarray]:
    """The continuations of some surfaces, at most one per pixel."""
    owner = _owners(patches, wide, scenery, room)
    masks = {patch.number: owner == patch.number for patch in patches}
    masks = {number: mask for number, mask in masks.items() if mask.sum() >= 30}
    kernel = np.ones((2 * OVERLAP_PX + 1, 2 * OVERLAP_PX + 1), np.uint8)
    seams = {n: (cv2.dilate(m.astype(np.uint8), kernel) > 0) & (wide.labels == n) for n, m in masks.items()}
    # One picture for all: a seam belongs to the surface visible in the photograph.
    seam = np.logical_or.reduce([np.zeros(owner.shape, bool), *seams.values()])
    picture = wide.colour.copy()
    for number, mask in masks.items():
        mask &= ~seam
        _paint(picture, mask, seams[number], wide, number)
    shown = np.clip(picture, 0, 255).astype(np.uint8)
    pieces = []
    for patch in patches:
        if patch.number in masks:
            whole = masks[patch.number] | seams[patch.number]
            piece = _piece(patch, whole, wide, scenery, room, stride, shown)
            if len(piece.faces):
                pieces.append(piece)
    return pieces, _at_photograph(np.where(np.isin(owner, list(masks)), owner, 0), wide, scenery.labels.shape)


def _at_photograph(owner: np.ndarray, wide: _Wide, shape: tuple[int, ...]) -> np.ndarray:
    """The owners (h, w) within the photograph, at its own size (H, W)."""
    rows, columns = np.flatnonzero(wide.inside.any(axis=1)), np.flatnonzero(wide.inside.any(axis=0))
    inner = owner[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    back = cv2.resize(inner.astype(np.float32), shape[::-1], interpolation=cv2.INTER_NEAREST)
    return np.asarray(back, np.int32)


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


def _owners(patches: list[Patch], wide: _Wide, scenery: Scenery, room: Room) -> np.ndarray:
    """The surface that continues at each pixel of the wider picture, (h, w) int32; 0 none."""
    best = np.full(wide.labels.shape, np.inf, np.float32)
    owner = np.zeros(wide.labels.shape, np.int32)
    for patch in patches:
        own = wide.labels == patch.number
        if not own.any():
            continue
        depth = patch.depth(wide.pixel, scenery.k)
        around = border(own, wide.depth, depth)
        broad = _broad(patch, wide, scenery, room)
        reach = NEAR * scenery.labels.shape[1] / HALF
        reach = max(reach, FAR * float(np.sqrt(own.sum()))) if broad else reach
        free = ~own & (around.away < reach) & around.goes_on[around.nearest] & (around.away < best)
        free &= np.isfinite(depth) & (depth > wide.depth + BEHIND_M)
        if not broad:
            free &= wide.labels > 0
        places = scenery.lift(wide.pixel, np.where(np.isfinite(depth), depth, np.nan))
        free[free] = room.holds(places[free])
        if broad:
            along = _along(patch, scenery, room)
            low, high = limits(around, own, places @ along.T)
            free[free] = ((places[free] @ along.T > low) & (places[free] @ along.T < high)).all(axis=-1)
        free = _touching(free, own)
        best[free], owner[free] = around.away[free], patch.number
    return owner


def _broad(patch: Patch, wide: _Wide, scenery: Scenery, room: Room) -> bool:
    """Whether a surface is a large plane along the room's walls or floor."""
    if patch.plane is None or (wide.labels == patch.number).sum() < LARGE * wide.inside.sum():
        return False
    normal = scenery.world_from_camera[:3, :3] @ patch.plane[0]
    return bool(np.abs(room.axes @ normal).max() > ALONG)


def _along(patch: Patch, scenery: Scenery, room: Room) -> np.ndarray:
    """The two of the room's axes (2, 3) parallel to a plane."""
    assert patch.plane is not None
    normal = scenery.world_from_camera[:3, :3] @ patch.plane[0]
    return room.axes[np.sort(np.argsort(np.abs(room.axes @ normal))[:2])]


def _touching(free: np.ndarray, own: np.ndarray) -> np.ndarray:
    """The parts of `free` that are connected with `own`."""
    _, labels = cv2.connectedComponents((free | own).astype(np.uint8), connectivity=4)
    kept = np.zeros(labels.max() + 1, bool)
    kept[labels[own]] = True
    return np.asarray(free & kept[labels])


def _paint(picture: np.ndarray, mask: np.ndarray, seam: np.ndarray, wide: _Wide, number: int) -> None:
    """Continue a surface's colours over its hidden part."""
    own = (wide.labels == number).astype(np.uint8)
    # Pixels at the border mix in the neighbour's colour.
    inner = (cv2.erode(own, np.ones((side, side), np.uint8), borderValue=1) > 0 for side in (7, 3, 1))
    known = next(mask for mask in inner if mask.sum() > 0.25 * own.sum())
    rows, columns = np.nonzero(mask | (own > 0))
    area = np.s_[int(rows.min()) : int(rows.max()) + 1, int(columns.min()) : int(columns.max()) + 1]
    colour = np.where(known[area][..., None], wide.colour[area], 0.0).astype(np.float32)
    found = membrane(colour, known[area])
    # Far from the visible part, the surface's mean colour is the better guess.
    away = cv2.distanceTransform((~known[area]).astype(np.uint8), cv2.DIST_L2, 3) / (FADE * wide.labels.shape[1])
    share = np.clip(away, 0.0, 1.0)[..., None]
    found = found * (1 - share) + wide.colour[known].mean(axis=0) * share
    picture[area] = np.where((mask | seam)[area][..., None], found, picture[area])


def _piece(
    patch: Patch, mask: np.ndarray, wide: _Wide, scenery: Scenery, room: Room, stride: float, picture: np.ndarray
) -> Piece:
    flat = patch.plane is not None
    points, faces = cut(mask, max(2.0, stride / HALF) * (3.0 if flat else 1.0), 6.0 if flat else 3.0)
    origin = wide.pixel[0, 0]
    pixel, faces = patch.fine(origin + points * HALF, faces, scenery.k, PUSH)
    points = (pixel - origin) / HALF
    depth = patch.depth(pixel, scenery.k)
    # The outline may extend slightly beyond the end of a plane that is seen edge on.
    good = np.isfinite(depth)
    good[good] = room.holds(scenery.lift(pixel[good], depth[good]), 0.05)
    faces = faces[good[faces].all(axis=1)]
    vertices = scenery.lift(pixel, np.where(good, depth, 1.0) * PUSH)
    return Piece(vertices, faces, points, picture)
