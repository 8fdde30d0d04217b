"""Which things stand on the support, directly or on one another; the rest hangs or reaches in from outside."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import regions

from .grouping import FEWEST, Grouping
from .patches import Surfaces

FOOT_M = 0.025
"""The lowest pixels of a thing that stands are not higher than this above the support [m]."""
LOOK = 4
"""Distance below a thing's lowest pixels where its ground is looked for [px]."""
FEW = 0.15
"""Part of a thing's lower border that must rest on something."""


def standing(parts: Grouping, cut: set[int]) -> set[int]:
    """Numbers of the groups that stand.

    Args:
        parts: All groups.
        cut: Numbers of groups that reach out of the image; they and what hangs on them do not count.
    """
    found = {number for number in parts.groups if number not in cut and _on_floor(parts.surfaces, parts, number)}
    attached = _attached(parts, cut, found)
    changed = True
    while changed:
        changed = False
        for number in sorted(set(parts.groups) - found - attached - cut):
            if _rests(parts, number, found):
                found.add(number)
                changed = True
    return found


def _attached(parts: Grouping, cut: set[int], on_floor: set[int]) -> set[int]:
    """Groups without ground of their own that meet a cut group, or one that does."""
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
    """Lowest pixel of each column of a group: rows and columns, and the row a little below it."""
    height, width = parts.labels.shape
    rows, columns = np.divmod(parts.groups[number].pixels, width)
    lowest = np.full(width, -1)
    np.maximum.at(lowest, columns, rows)
    present = np.flatnonzero(lowest >= 0)
    return lowest[present], present, np.minimum(lowest[present] + LOOK, height - 1)


def _on_floor(s: Surfaces, parts: Grouping, number: int) -> bool:
    rows, columns, below = _below(parts, number)
    # The lower border of a round bowl is where sight lines touch it, well above its foot.
    limit = np.clip(0.8 * parts.groups[number].top_m, FOOT_M, 2.4 * FOOT_M)
    low = s.height[np.maximum(rows - 1, 0), columns] < limit
    return bool((low & (parts.labels[below, columns] == 0)).mean() > FEW)


def _rests(parts: Grouping, number: int, found: set[int]) -> bool:
    """Whether a group lies on a standing one, or its lower border is hidden by one."""
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
