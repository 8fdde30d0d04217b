"""The support as a closed slab, cut at its outline, with the texture of its visible part everywhere."""

from __future__ import annotations

import cv2
import numpy as np

from .holes import shaded
from .layers import grown
from .pieces import Piece
from .scenery import Scenery
from .synthesis import fill_texture, membrane

UNDER_M = 0.001
"""Distance of the slab's top below the photographed surface [m]."""
RIM = 15
"""Width of a square around each source texel that must be entirely support [texels]."""
EDGE = 2
"""Width of the strip along the border of what is visible whose colour goes on: lenses darken the picture's border
steeply, and a mean over more of it differs from the colour at the border [texels]."""
LEAST_EDGE = 100
"""Minimum number of texels of this strip."""
ALONG = 24
"""Number of points per side that are tested."""
LEVELS = 8
"""Number of thicknesses that are tried."""
HIDES_M = 0.05
"""A side hides points that are farther behind it than this [m]."""
MOST_HIDDEN = 0.5
"""Fraction of the points of the sides that may hide something, because the outline is known to a few pixels only."""
TEXELS = 768
"""Longest edge of the slab's picture."""


def slab(scenery: Scenery, edge: np.ndarray, most: float) -> list[Piece]:
    """Top, sides and underside of the support.

    Args:
        scenery: The visible empty scene.
        edge: (P, 2) convex outline, counter-clockwise [m].
        most: Maximum thickness, reduced if its sides would hide visible surfaces [m].
    """
    count, thickness = len(edge), _thickness(scenery, edge, most)
    low = edge.min(axis=0)
    texel = float(np.ptp(edge, axis=0).max()) / TEXELS
    width, height = (int(n) for n in np.ceil(np.ptp(edge, axis=0) / texel) + 1)
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    flat = np.stack([low[0] + columns * texel, low[1] + rows * texel, np.zeros(rows.shape)], axis=-1)
    colour, shown = scenery.colours(flat, 0.02, unmeasured=True)
    shown = cv2.erode(shown.astype(np.uint8), np.ones((5, 5), np.uint8), borderValue=0) > 0
    picture = np.clip(_continued(colour, shown), 0, 255).astype(np.uint8)
    pixel = (edge - low) / texel
    fan = np.array([[0, i, i + 1] for i in range(1, count - 1)])
    top, bottom = (np.concatenate([edge, np.full((count, 1), z)], axis=1) for z in (-UNDER_M, -thickness))
    # Every side is a plane with its own corners.
    rings = [ring for level in (top, bottom) for ring in (level, np.roll(level, -1, axis=0))]
    first, after, first_low, after_low = np.arange(4 * count).reshape(4, count)
    sides = np.concatenate([np.stack([first, first_low, after], 1), np.stack([after, first_low, after_low], 1)])
    around = np.concatenate([pixel, np.roll(pixel, -1, axis=0)] * 2)
    dark = np.clip(0.75 * picture.astype(np.float32), 0, 255).astype(np.uint8)
    return [
        Piece(top, fan, pixel, picture),
        Piece(np.concatenate(rings), sides, around, dark),
        Piece(bottom, fan[:, ::-1], pixel, dark),
    ]


def _thickness(scenery: Scenery, edge: np.ndarray, most: float) -> float:
    """The largest thickness up to `most` whose sides hide little of the photograph beneath the edge [m]."""
    share = np.linspace(0.0, 1.0, ALONG, endpoint=False)[:, None, None]
    ring = (edge + share * (np.roll(edge, -1, axis=0) - edge)).reshape(-1, 2)
    out = np.stack([np.roll(edge, -1, axis=0) - edge] * ALONG).reshape(-1, 2) @ np.array([[0.0, -1.0], [1.0, 0.0]])
    facing = ((scenery.world_from_camera[:2, 3] - ring) * out).sum(axis=1) > 0
    levels = most * np.arange(1, LEVELS + 1) / LEVELS
    for number, level in enumerate(levels):
        points = np.column_stack([ring[facing], np.full(facing.sum(), -level)])
        row, column, inside, z = scenery.find(points)
        shown = inside & (scenery.depth[row, column] > 0)
        hides = shown & (scenery.depth[row, column] > z + HIDES_M)
        if shown.any() and hides.sum() > MOST_HIDDEN * shown.sum():
            return float(levels[max(0, number - 1)])
    return most


def _continued(colour: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """A top view filled with the texture of its visible part; none if hardly anything is visible."""
    if shown.sum() < 500:
        return membrane(np.where(shown[..., None], colour, 0.0).astype(np.float32), shown)
    # Neither flat objects on the support, nor objects at its border, nor their surroundings are sources of texture.
    own = shown & shaded(colour.astype(np.uint8), shown, ~shown)
    inner = cv2.erode(own.astype(np.uint8), np.ones((RIM, RIM), np.uint8), borderValue=1) > 0
    source = inner if inner.sum() >= 500 else own
    edge = own & grown(~shown, EDGE)
    return fill_texture(
        np.where(shown[..., None], colour, 0.0),
        ~shown,
        source,
        np.ones(shown.shape, np.float32),
        context=own | source,
        edge=edge if edge.sum() >= LEAST_EDGE else None,
    )
