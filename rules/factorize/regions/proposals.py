"""Object proposals above the support: their pixels, and whether they can be handled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry.regions import box_of

from ..measured import Workspace
from ..overlap import Box
from . import borders, grouping, heights, patches, relations, smears
from .partition import Grouping
from .relations import Group
from .standing import on_support, standing

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
    """Cut by the image border so that less than most of it is in view, too large, or not supported by anything."""
    cut: bool
    """Whether it stands on the support, small enough to be handled, and the image border cuts it."""


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
    above = relief.raised & (relief.over | relief.continued)
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
    cut, shares = _cut(relief, seen, parts, things)
    beyond = {n for n, mask in things.items() if shares[n] < borders.MOST or _extent(relief, mask) > LARGEST_M}
    sunk = {n for n in cut - beyond if borders.BOTTOM in borders.touched(things[n])}
    handled = standing(parts, beyond, sunk)
    found = [_proposal(parts, number, mask, number in cut, number in handled) for number, mask in things.items()]
    found.sort(key=lambda p: (-p.area_m2, p.box))
    taken = np.zeros(raised.shape, bool)
    for proposal in found:
        taken |= proposal.mask
    return Scenery(relief, tuple(found), relief.raised & ~taken)


def colour_lab(pixels: np.ndarray) -> np.ndarray:
    """Convert (H, W, 3) uint8 sRGB to CIE L*a*b* (D65) float32."""
    import cv2

    return np.asarray(cv2.cvtColor(pixels.astype(np.float32) / 255.0, cv2.COLOR_RGB2LAB))


def _extent(relief: heights.Relief, mask: np.ndarray) -> float:
    """Largest extent of an object along a world axis, without the outermost 2 % [m]."""
    points = relief.points[mask]
    return float(np.max(np.quantile(points, 0.99, axis=0) - np.quantile(points, 0.01, axis=0)))


def _cut(
    relief: heights.Relief, seen: Workspace, parts: Grouping, things: dict[int, np.ndarray]
) -> tuple[set[int], dict[int, float]]:
    """Objects that the border cuts, and the fraction of each group in view, 0 if unknown.

    Args:
        relief: Heights of the capture.
        seen: The capture.
        parts: All groups.
        things: Group -> mask (H, W) bool.
    """
    floor = relief.over & (np.abs(relief.height) <= relief.threshold)
    cut, shares = set[int](), dict.fromkeys(things, 1.0)
    for number, mask in things.items():
        sides = borders.touched(mask)
        if sides:
            group = parts.groups[number]
            shares[number] = 0.0
            if group.area_m2 < borders.LEAST_M2 or group.top_m < borders.LEAST_M:
                continue
            shares[number] = borders.in_view(parts.surfaces, group, mask, floor, seen)
            foot = borders.above_border(parts.surfaces, group, mask, floor) if borders.BOTTOM in sides else 0.0
            if _extent(relief, mask) <= LARGEST_M and (foot > 0.0 or on_support(parts, number)):
                cut.add(number)
    return cut, shares


def _proposal(parts: Grouping, number: int, mask: np.ndarray, cut: bool, handled: bool) -> Proposal:
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
        cut=cut,
    )
