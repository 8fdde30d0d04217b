"""How far a joint goes until its links collide."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from manifold3d import Manifold

STEPS = 16
"""Number of positions that are tried on each side."""
ALLOWED = 0.02
"""Share of the smaller link's volume that may overlap beyond what overlaps as seen: cuts at the hinge are coarse."""


def free(
    moving: Manifold, others: list[Manifold], motion: Callable[[float], np.ndarray], start: float, end: float
) -> tuple[float, bool]:
    """The last position from `start` towards `end` without a collision, and whether one stopped it.

    Args:
        moving: What the joint moves, at position `start`.
        others: What stays.
        motion: Position -> (4, 4) motion of `moving` from `start`.
        start: Position that was seen [rad or m].
        end: Where the search ends.
    """

    def overlap(position: float) -> float:
        moved = moving.transform(motion(position - start)[:3])
        return sum(float((moved ^ other).volume()) for other in others)

    least = min([float(moving.volume()), *(float(other.volume()) for other in others)])
    limit = overlap(start) + ALLOWED * least
    last = start
    for position in np.linspace(start, end, STEPS + 1)[1:]:
        if overlap(float(position)) > limit:
            return last, True
        last = float(position)
    return last, False
