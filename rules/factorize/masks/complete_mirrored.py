"""Backend `mirrored` of factorize.complete: completion by symmetry and convexity, from the view alone.

Most objects on tables are approximately symmetric about some line in the picture. A line is accepted if hardly any
pixel of the mirrored mask is at a visible pixel of something else; mirrored pixels on the occluder are added to the
mask with their colours. Between visible parts the mask is completed to its convex outline, with the colours of the
nearest visible pixels.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field, PositiveInt

from dextera_build.artifacts.objects.view import ObjectView
from dextera_build.rule import Backend, Context, Fraction, Options

from ..regions.patches import spread
from .mirror import best_line, convex, mirrored

BACKEND = Backend(
    summary="mirrors the visible part about its line of symmetry, closes it convexly",
    profiles=("cpu",),
    packages=("numpy", "scipy"),
    extra="twin",
)


class MirroredOptions(Options):
    """Options of backend `mirrored` of factorize.complete."""

    astray: Fraction = 0.03
    """Largest fraction of the mirrored mask on visible pixels of something else."""
    shared: Fraction = 0.5
    """Smallest fraction of the mirrored mask on the mask itself."""
    angles: PositiveInt = 24
    """Number of directions of symmetry lines that are tried."""
    longest_px: int = Field(96, ge=16, le=1024)
    """Longest side of the reduced crop in which lines are tried [px]."""


def complete(ctx: Context, view: ObjectView, options: MirroredOptions) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of the occluder assigned to the object by symmetry and convexity, with their colours."""
    hidden = view.occluder & ~view.mask
    if not view.mask.any() or not hidden.any():
        return view.rgb.pixels, view.mask
    line = best_line(view.mask, hidden, options.angles, options.astray, options.shared, options.longest_px)
    pixels = view.rgb.pixels.copy()
    added = convex(view.mask) & hidden
    copied = np.zeros_like(added)
    if line is not None:
        rows, columns, inside = mirrored(view.mask.shape, line)
        copied = hidden & inside & view.mask[rows, columns]
        pixels[copied] = pixels[rows[copied], columns[copied]]
    added = _attached(view.mask, added | copied)
    rest = added & ~copied
    pixels[rest] = _nearest(view.rgb.pixels, view.mask)[rest]
    ctx.metric("symmetric", float(line is not None))
    return pixels, view.mask | added


def _attached(mask: np.ndarray, added: np.ndarray) -> np.ndarray:
    """The parts of `added` (H, W) bool that touch the mask."""
    from scipy import ndimage

    parts, _ = ndimage.label(mask | added)
    return np.asarray(added & np.isin(parts, np.unique(parts[mask])))


def _nearest(pixels: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Colours (H, W, 3) uint8 of the nearest pixel of the mask."""
    numbers = np.where(mask, np.arange(1, mask.size + 1).reshape(mask.shape), 0)
    nearest = spread(numbers, ~mask, np.inf)
    return np.asarray(pixels.reshape(-1, 3)[np.maximum(nearest, 1) - 1])
