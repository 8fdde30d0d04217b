"""Find the objects that are supported by the support plane, by a level of the furniture, or by one another.

All others hang, or extend into the picture from outside.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import regions

from .partition import FEWEST, Grouping
from .patches import Surfaces

FOOT_M = 0.025
"""Maximum height above the support of a standing object's lowest pixels [m]."""
LOOK = 4
"""Distance below an object's lowest pixels at which the ground is sampled [px]."""
STEEP = 0.9
"""Sine of the pitch of a line of sight above which an object hides its own foot."""
MOSTLY = 0.6
"""Fraction of the surroundings of an object seen from above that must belong to the support."""
FEW = 0.15
"""Fraction of an object's lower border that must rest on something."""
DEEPER = 12
"""Distance below an object's lowest pixels within which it would continue below the support [px]."""
SAME_M = 0.04
"""Largest depth difference between pixels of one object above and below the support's level [m]."""
FAR_M = 0.15
"""A surface seen below an object but this far behind it does not support it [m]."""
LEVEL_M2 = 0.01
"""Minimum visible area of a level of the furniture, such as the board of a shelf [m^2]."""
LEVEL = 0.97
"""Cosine of the angle to the vertical up to which a surface is level."""


@dataclass(frozen=True)
class Ground:
    """A surface that carries objects: the support, or a level of the furniture on it."""

    pixels: np.ndarray
    """(h, w) bool."""
    height_m: float
    """Above the support [m]."""


def standing(parts: Grouping, cut: set[int], sunk: set[int]) -> set[int]:
    """Numbers of the standing groups.

    Args:
        parts: All groups.
        cut: Numbers of groups that extend beyond the image; these and groups attached to them are excluded.
        sunk: Numbers of groups whose foot is below the image, on the support that is seen beside them.
    """
    grounds = [Ground(parts.labels == 0, 0.0), *_levels(parts, cut)]
    free = sorted(set(parts.groups) - cut)
    found = {number for number in free if number in sunk or _stands(parts, number, grounds)}
    attached = _attached(parts, cut, found)
    changed = True
    while changed:
        changed = False
        for number in sorted(set(parts.groups) - found - attached - cut):
            if _rests(parts, number, found):
                found.add(number)
                changed = True
    return found


def on_support(parts: Grouping, number: int) -> bool:
    """Whether a group's foot is seen on the support."""
    return _stands(parts, number, [Ground(parts.labels == 0, 0.0)])


def _attached(parts: Grouping, cut: set[int], on_floor: set[int]) -> set[int]:
    """Groups without ground contact that meet a cut group, directly or through others."""
    found: set[int] = set()
    edge = sorted(cut)
    while edge:
        number = edge.pop()
        for other in parts.neighbours(number):
            new = other not in found and other not in cut and other not in on_floor
            if new and parts.contact(number, other).meeting >= FEWEST:
                found.add(other)
                edge.append(other)
    return found


def _below(parts: Grouping, number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lowest pixel of each column of a group: rows, columns, and the rows slightly below."""
    height, width = parts.labels.shape
    rows, columns = np.divmod(parts.groups[number].pixels, width)
    lowest = np.full(width, -1)
    np.maximum.at(lowest, columns, rows)
    present = np.flatnonzero(lowest >= 0)
    return lowest[present], present, np.minimum(lowest[present] + LOOK, height - 1)


def _levels(parts: Grouping, cut: set[int]) -> Iterator[Ground]:
    """Level patches of static elements."""
    for number in sorted(cut):
        for patch in (parts.patches[member] for member in parts.members[number]):
            if patch.area_m2 >= LEVEL_M2 and abs(float(patch.plane[0][2])) > LEVEL:
                pixels = np.zeros(parts.labels.shape, bool)
                pixels.ravel()[patch.pixels] = True
                yield Ground(pixels, float(patch.middle[2]))


def _stands(parts: Grouping, number: int, grounds: Sequence[Ground]) -> bool:
    """Whether a group is supported by one of the grounds."""
    border = _below(parts, number)
    return any(_stands_on(parts, number, border, ground) for ground in grounds)


def _stands_on(parts: Grouping, number: int, border: tuple[np.ndarray, np.ndarray, np.ndarray], ground: Ground) -> bool:
    s = parts.surfaces
    above = parts.groups[number].top_m - ground.height_m
    if above < 0:
        return False
    if ground.height_m == 0 and _seen_from_above(s, parts, number):
        return True
    rows, columns, below = border
    beside = _beside(s, rows, columns) if ground.height_m == 0 else np.zeros(len(rows), bool)
    if beside.mean() > 0.5:
        return False
    # The lower border of a round bowl is tangent to the lines of sight, well above its foot.
    limit = np.clip(0.8 * above, FOOT_M, 2.4 * FOOT_M)
    low = s.height[np.maximum(rows - 1, 0), columns] - ground.height_m < limit
    return bool((low & ~beside & ground.pixels[below, columns]).mean() > FEW)


def _beside(s: Surfaces, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Columns of a lower border (n,) that do not end on the support: the object continues, or the view passes below it.

    An example is the back of a chair behind a table.
    """
    depth = 1.0 / np.maximum(s.inverse[rows, columns], 1e-6)
    found = np.zeros(len(rows), bool)
    for down in range(1, DEEPER + 1):
        other = s.beyond[np.minimum(rows + down, s.beyond.shape[0] - 1), columns]
        found |= (other > 0) & ((np.abs(other - depth) < SAME_M) | (other > depth + FAR_M))
    return found


def _seen_from_above(s: Surfaces, parts: Grouping, number: int) -> bool:
    """Whether a group is seen so steeply that it hides its own foot, with the support all around it.

    Its borders are then those of its top, so that standing and hanging objects cannot be distinguished.
    """
    from scipy import ndimage

    own = np.zeros(parts.labels.size, bool)
    own[parts.groups[number].pixels] = True
    towards = np.median(s.points.reshape(-1, 3)[own], axis=0) - s.eye
    if -towards[2] < STEEP * np.linalg.norm(towards):
        return False
    mask = own.reshape(parts.labels.shape)
    near, ring = (ndimage.binary_dilation(mask, iterations=reach) for reach in (1, LOOK))
    around = ring & ~near & (s.floor | s.raised)
    return bool(around.any() and s.floor[around].mean() > MOSTLY)


def _rests(parts: Grouping, number: int, found: set[int]) -> bool:
    """Whether a group rests on a standing one, or its lower border is hidden by one."""
    _, columns, below = _below(parts, number)
    if np.isin(parts.labels[below, columns], sorted(found)).mean() > FEW:
        return True
    points = parts.surfaces.points.reshape(-1, 3)
    own = points[parts.groups[number].pixels]
    bottom = float(np.quantile(own[:, 2], 0.05))
    for other in sorted(found):
        carrier = parts.groups[other]
        if bottom < carrier.top_m + FOOT_M:
            outline = regions.convex_hull(points[carrier.pixels][:, :2])
            if regions.inside_convex(own[:, :2], outline).mean() > 0.2:
                return True
    return False
