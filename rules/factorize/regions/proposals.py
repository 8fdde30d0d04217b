"""Objects that stand out from the support: their pixels, and which of them can be handled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.camera import Capture
from dextera_build.artifacts.object import Support

from . import grouping, heights, patches, relations
from .relations import Group
from .standing import standing

LARGEST_M = 0.6
"""Things longer than this are furniture or robots."""
SMALLEST_M2 = 0.0006
"""Things with less surface in view than this are noise."""
LOWEST_M = 0.012
"""Things that rise less than this cannot be told from the support."""


@dataclass(frozen=True)
class Proposal:
    """One thing above the support."""

    mask: np.ndarray
    """(H, W) bool."""
    box: tuple[int, int, int, int]
    """left, top, right, bottom [px], right and bottom excluded."""
    area_m2: float
    """Surface in view [m^2]."""
    top_m: float
    """Height above the support [m]."""
    patches: tuple[Group, ...]
    """Smooth pieces of its surface, largest first."""
    facets: tuple[tuple[np.ndarray, float], ...]
    """Commonest directions of its surface, (3,) world, and the part of its pixels that face each."""
    inward: float
    """Part of its seen surface that faces its own middle, as only the inside of a hollow thing does."""
    hinged: bool
    """Two plates that meet in a crease, like a laptop."""
    static: str
    """`robot` for things that the image border cuts, that are too large or do not stand on the support; else empty."""


@dataclass(frozen=True)
class Scenery:
    """The pixels and objects above the support."""

    relief: heights.Relief
    objects: tuple[Proposal, ...]
    """Largest first."""
    other: np.ndarray
    """(H, W) bool, raised pixels that belong to none of them."""


def scenery(capture: Capture, support: Support) -> Scenery:
    """Split what rises above the support into objects."""
    from scipy import ndimage

    relief = heights.relief(capture, support)
    raised = ndimage.binary_opening(relief.raised & relief.over, np.ones((3, 3), bool))
    if not raised.any():
        return Scenery(relief, (), relief.raised)
    lab = colour_lab(capture.rgb.pixels)
    crop = patches.surfaces(relief, raised, capture, support.world_from_camera, lab)
    parts = grouping.group(crop, patches.patches(crop))
    labels = crop.full(parts.labels, raised)
    things = {
        number: labels == number
        for number, part in sorted(parts.groups.items())
        if part.area_m2 >= SMALLEST_M2 and part.top_m >= LOWEST_M and (labels == number).any()
    }
    cut = {number for number, mask in things.items() if _is_cut(relief, mask)}
    handled = standing(parts, cut)
    found = [_proposal(parts, number, mask, number in handled) for number, mask in things.items()]
    found.sort(key=lambda p: (-p.area_m2, p.box))
    taken = np.zeros(raised.shape, bool)
    for proposal in found:
        taken |= proposal.mask
    return Scenery(relief, tuple(found), relief.raised & ~taken)


def colour_lab(pixels: np.ndarray) -> np.ndarray:
    """CIE L*a*b* (D65) float32 of (H, W, 3) uint8 sRGB."""
    import cv2

    return np.asarray(cv2.cvtColor(pixels.astype(np.float32) / 255.0, cv2.COLOR_RGB2LAB))


def box_of(mask: np.ndarray) -> tuple[int, int, int, int]:
    """left, top, right, bottom of a mask's pixels [px], right and bottom excluded."""
    rows, columns = np.nonzero(mask)
    return int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1


def _is_cut(relief: heights.Relief, mask: np.ndarray) -> bool:
    """Whether a thing reaches out of the image or is too large to be handled."""
    points = relief.points[mask]
    extent = float(np.max(np.quantile(points, 0.99, axis=0) - np.quantile(points, 0.01, axis=0)))
    border = mask[:2].any() or mask[-2:].any() or mask[:, :2].any() or mask[:, -2:].any()
    return bool(border) or extent > LARGEST_M


def _proposal(parts: grouping.Grouping, number: int, mask: np.ndarray, handled: bool) -> Proposal:
    part = parts.groups[number]
    pieces = tuple(sorted((parts.patches[n] for n in parts.members[number]), key=lambda p: -p.area_m2))
    return Proposal(
        mask=mask,
        box=box_of(mask),
        area_m2=part.area_m2,
        top_m=part.top_m,
        patches=pieces,
        facets=relations.facets(parts.surfaces, part),
        inward=relations.inward(parts.surfaces, part),
        hinged=number in parts.hinged,
        static="" if handled else "robot",
    )
