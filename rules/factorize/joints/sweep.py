"""Range of a joint until its links collide."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from manifold3d import Manifold

STEPS = 16
"""Number of positions tested on each side."""
ALLOWED = 0.02
"""Allowed overlap beyond the overlap as seen, as a fraction of the smaller link's volume: cuts at the hinge are
coarse."""


def free(
    moving: Manifold, others: list[Manifold], motion: Callable[[float], np.ndarray], start: float, end: float
) -> tuple[float, bool]:
    """The last collision-free position from `start` towards `end`, and whether a collision ended the sweep.

    Args:
        moving: The moving link, at position `start`.
        others: The other links.
        motion: Position -> (4, 4) motion of `moving` from `start`.
        start: Observed position [rad or m].
        end: End of the search [rad or m].
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
