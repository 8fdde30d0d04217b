"""Object proposals above the support: their pixels, and whether they can be handled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..measured import Workspace
from ..overlap import Box, box_of
from . import grouping, heights, patches, relations, smears
from .partition import Grouping
from .relations import Group
from .standing import standing

LARGEST_M = 0.6
"""Longer objects are furniture or robots."""
SMALLEST_M2 = 0.0006
"""Objects with less visible surface are noise."""
LOWEST_M = 0.012
"""Lower objects cannot be distinguished from the support."""


@dataclass(frozen=True)
class Proposal:
    """One object above the support."""

    mask: np.ndarray
    """(H, W) bool."""
    box: Box
    """left, top, right, bottom [px], right and bottom excluded."""
    area_m2: float
    """Visible surface [m^2]."""
    top_m: float
    """Height above the support [m]."""
    patches: tuple[Group, ...]
    """Smooth surface patches, largest first."""
    facets: tuple[tuple[np.ndarray, float], ...]
    """Dominant surface normals, (3,) world, each with the fraction of pixels that share it."""
    inward: float
    """Fraction of the seen surface that faces the object's centre; only hollow objects have such a surface."""
    hinged: bool
    """Whether two plates meet at a crease, as in a laptop."""
    static: bool
    """Cut by the image border, too large, or not supported by anything."""


@dataclass(frozen=True)
class Scenery:
    """The pixels and objects above the support."""

    relief: heights.Relief
    objects: tuple[Proposal, ...]
    """Largest first."""
    other: np.ndarray
    """(H, W) bool, raised pixels outside all objects."""

    @property
    def labels(self) -> np.ndarray:
        """(H, W) int32, object of each pixel, 1.. in the order of `objects`; 0 elsewhere."""
        labels = np.zeros(self.other.shape, np.int32)
        for number, proposal in enumerate(self.objects, start=1):
            labels[proposal.mask] = number
        return labels


def scenery(seen: Workspace) -> Scenery:
    """Split the pixels above the support into objects."""
    from scipy import ndimage

    relief = heights.relief(seen)
    above = relief.raised & relief.over
    above = above if seen.robot is None else above & ~seen.robot
    raised = ndimage.binary_opening(above, np.ones((3, 3), bool))
    if not raised.any():
        return Scenery(relief, (), relief.raised)
    lab = colour_lab(seen.pixels)
    crop = patches.surfaces(relief, raised, seen, lab)
    smeared = crop.full(smears.smeared(crop, crop.floor).astype(np.int32), raised) > 0
    if smeared.any() and (raised & ~smeared).any():
        raised = raised & ~smeared
        crop = patches.surfaces(relief, raised, seen, lab)
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
    """Convert (H, W, 3) uint8 sRGB to CIE L*a*b* (D65) float32."""
    import cv2

    return np.asarray(cv2.cvtColor(pixels.astype(np.float32) / 255.0, cv2.COLOR_RGB2LAB))


def _is_cut(relief: heights.Relief, mask: np.ndarray) -> bool:
    """Whether an object extends beyond the image or is too large to be handled."""
    points = relief.points[mask]
    extent = float(np.max(np.quantile(points, 0.99, axis=0) - np.quantile(points, 0.01, axis=0)))
    border = mask[:2].any() or mask[-2:].any() or mask[:, :2].any() or mask[:, -2:].any()
    return bool(border) or extent > LARGEST_M


def _proposal(parts: Grouping, number: int, mask: np.ndarray, handled: bool) -> Proposal:
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
        static=not handled,
    )
