"""Clear and shiny things on the support: where depth is missing, or is of what is behind, and the picture has outlines.

Depth cameras see through glass, and nothing of mirrors. What remains of such a thing is scraps, which are no bodies.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dextera_build.geometry import cameras, regions, transforms
from dextera_build.geometry.regions import box_of

from ..measured import Workspace
from ..overlap import Box, inwards
from ..regions import proposals
from ..regions.heights import least_height
from . import colours

SINKS_M = 0.004
"""Points lower than this, in addition to the noise, are seen through something [m]."""
LEAST_M2 = 0.0012
"""Smallest area of a clear thing on the support [m^2]."""
THICK_M = 0.008
"""Least half width of a clear thing; the band without depth beside an object is narrower [m]."""
OUTLINED = 0.15
"""Fraction of the pixels of a clear thing that differ from the support, in colour or by an edge."""
UNLIKE_LAB = 12.0
"""Distance of a colour from all colours of the support nearby [CIE Lab]."""
EDGY = 0.98
"""Quantile of the strength of the support's edges; an outline is half as strong again."""
AROUND_PX = 40
"""Distance within which the support's colours are compared [px]."""
SCRAP = 0.35
"""Fraction of an object's surroundings that is clear if the object is a scrap of a clear thing."""
MISSING = 0.5
"""Least fraction of a clear thing without depth, or with that of what is behind. Bodies of drawn scenes whose depth has
gaps had up to 0.34."""
LARGEST_M = 0.4
"""Larger regions without depth are parts of the support [m]."""
BESIDE = 0.4
"""Fraction of its surroundings above which a region without depth belongs to the objects beside it."""
RING_PX = 4
"""Width of the surroundings [px]."""
BORDER_PX = 2
"""Distance from an object's mask within which missing depth is its border's [px]."""
STEP = 0.03
"""Difference of depth between neighbours above which a surface does not go on, relative to the depth."""


@dataclass(frozen=True)
class Clear:
    """A clear or shiny thing."""

    mask: np.ndarray
    """(H, W) bool, its pixels, with those of its scraps."""
    without: float
    """Fraction of them that have no depth, or that of something behind."""
    scraps: tuple[str, ...]
    """Objects that are scraps of it."""

    @property
    def box(self) -> Box:
        """left, top, right, bottom [px], right and bottom excluded."""
        return box_of(self.mask)


def clear_things(seen: Workspace, masks: Mapping[str, np.ndarray]) -> list[Clear]:
    """Clear and shiny things on the support, from the left.

    Args:
        seen: The photograph with its depth.
        masks: Name -> pixels (H, W) bool of the objects that were found.
    """
    from scipy import ndimage

    odd, area, places = _odd(seen)
    scraps = {name: mask for name, mask in masks.items() if _ring(mask, odd) > SCRAP and not _is_solid(mask, odd, area)}
    taken = _opaque(seen, masks, odd, area)
    for name, mask in masks.items():
        taken |= mask if name not in scraps else False
    # The surroundings of a hole begin where it ends, and with them the bodies beside it.
    taken = ndimage.binary_dilation(taken, iterations=BORDER_PX)
    holes = ndimage.binary_opening(odd & ~taken, np.ones((3, 3), bool))
    own = holes.copy()
    for mask in scraps.values():
        own |= mask
    labels, count = regions.label(ndimage.binary_closing(np.pad(own, 6), np.ones((5, 5), bool))[6:-6, 6:-6])
    likely = []
    for number in range(1, count + 1):
        mask = labels == number
        extent = float(np.ptp(places[mask], axis=0).max())
        if float(area[mask & odd].sum()) < LEAST_M2 or extent > LARGEST_M or odd[mask].mean() < MISSING:
            continue
        if is_thick(mask, area) and _ring(mask, taken) <= BESIDE:
            likely.append(mask)
    if not likely:
        return []
    surface, found = surface_of(seen), []
    for mask in likely:
        if _outlined(surface, mask, odd | taken) > OUTLINED:
            names = tuple(name for name, scrap in scraps.items() if (scrap & mask).sum() > 0.5 * scrap.sum())
            found.append(Clear(mask, float(odd[mask].mean()), names))
    return sorted(found, key=lambda thing: thing.box)


def _odd(seen: Workspace) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (H, W) bool without depth over the support, or with depth below it that is not of what goes on beyond it.

    Also the area of the support in each [m^2], and its place there (H, W, 2) [m].
    """
    depth = seen.depth.astype(np.float64)
    over, expected = seen.over_support()
    low = (depth > 0) & (seen.world_points()[..., 2] < -SINKS_M - least_height(depth))
    odd = over & ((depth <= 0) | (low & ~_beyond(depth, low, over)))
    if seen.robot is not None:
        odd &= ~seen.robot
    places = transforms.apply(seen.world_from_camera, cameras.backproject(expected, seen.k))[..., :2]
    return odd, np.where(over, np.square(expected) / (seen.camera.fx * seen.camera.fy), 0.0), places


def _beyond(depth: np.ndarray, low: np.ndarray, over: np.ndarray) -> np.ndarray:
    """Pixels (H, W) bool of surfaces below the support that are for the most part seen beside it.

    The outline of the support is convex and may include a strip of the floor, which is not seen through anything.
    """
    from scipy import ndimage

    near, far = (find(depth, size=3) for find in (ndimage.minimum_filter, ndimage.maximum_filter))
    labels, count = regions.label(low & (far - near < STEP * depth))
    inside, every = (np.bincount(labels[where], minlength=count + 1) for where in (over, np.ones_like(over)))
    larger = 2 * inside < every
    larger[0] = False
    return np.asarray(ndimage.binary_dilation(larger[labels], iterations=BORDER_PX) & low)


def _opaque(seen: Workspace, masks: Mapping[str, np.ndarray], odd: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Pixels (H, W) bool above the support in no mask, of things larger than the regions without depth beside them."""
    points = seen.world_points()
    high = (seen.depth > 0) & (points[..., 2] > SINKS_M + least_height(seen.depth.astype(np.float64)))
    high &= regions.inside_convex(points[..., :2], seen.support.polygon)
    for mask in masks.values():
        high &= ~mask
    found = np.zeros_like(high)
    labels, _ = regions.label(high)
    for number in np.flatnonzero(np.bincount(labels.ravel(), area.ravel()) > LEAST_M2):
        if number and _is_solid(labels == number, odd, area):
            found |= labels == number
    return found


def _is_solid(mask: np.ndarray, odd: np.ndarray, area: np.ndarray) -> bool:
    """Whether an object is larger than the regions without depth that touch it."""
    from scipy import ndimage

    labels, _ = regions.label(odd & ~mask)
    beside = np.unique(labels[ndimage.binary_dilation(mask, iterations=RING_PX)])
    return float(area[np.isin(labels, beside[beside > 0])].sum()) < float(area[mask].sum())


def _ring(mask: np.ndarray, other: np.ndarray) -> float:
    """Fraction of the surroundings of a mask that another one covers."""
    from scipy import ndimage

    ring = ndimage.binary_dilation(mask, iterations=RING_PX) & ~mask
    return float(other[ring].mean()) if ring.any() else 0.0


def is_thick(mask: np.ndarray, area: np.ndarray) -> bool:
    """Whether a mask (H, W) is wider than bands beside objects; `area` (H, W) is that of its pixels [m^2]."""
    inside = float(inwards(mask).max())
    return inside * float(np.sqrt(np.median(area[mask]))) > THICK_M


class Surface(NamedTuple):
    """The picture as it is compared with the support."""

    bare: np.ndarray
    """Pixels (H, W) bool over the support whose depth is that of the support, within the noise."""
    lab: np.ndarray
    """Colours (H, W, 3) [CIE Lab]."""
    edge: np.ndarray
    """Strength of edges (H, W)."""


def surface_of(seen: Workspace) -> Surface:
    """The picture of a capture, and where it shows the support."""
    from scipy import ndimage

    level = np.abs(seen.world_points()[..., 2]) < least_height(seen.depth.astype(np.float64))
    lab = proposals.colour_lab(seen.pixels)
    smooth = ndimage.gaussian_filter(lab[..., 0], 1.0)
    edge = np.hypot(ndimage.sobel(smooth, axis=0), ndimage.sobel(smooth, axis=1))
    return Surface(seen.over_support()[0] & level, lab, edge)


def _outlined(surface: Surface, mask: np.ndarray, not_support: np.ndarray) -> float:
    """Fraction of the pixels of a mask whose colour the support beside it lacks, or that are sharper than its edges."""
    from scipy import ndimage

    around = ndimage.binary_dilation(mask, iterations=AROUND_PX) & ~ndimage.binary_dilation(mask, iterations=RING_PX)
    beside = around & ~not_support & surface.bare
    if not beside.any():
        return 0.0
    lab, edge = surface.lab, surface.edge
    unlike = colours.distances(lab, mask, beside) > UNLIKE_LAB
    return float((unlike | (edge[mask] > 1.5 * np.quantile(edge[beside], EDGY))).mean())
