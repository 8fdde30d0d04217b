"""Division of patches that go on above and below a ledge: the side of a thing, and that of what stands at its edge.

Where the foot of one thing is flush with the side of another, both sides are one smooth patch. The top of the lower
thing, beside that foot, tells them apart: it meets the upper side in a concave crease and the lower one in a convex
one.
"""

from __future__ import annotations

import numpy as np

from . import relations
from .partition import FEWEST
from .patches import Surfaces

LEVEL = 0.9
"""Cosine of the angle to the vertical up to which a ledge is level."""
LEAST_M2 = 0.0015
"""Smallest side above and below a ledge [m^2]."""
LEDGE_M2 = 0.0004
"""Smallest ledge [m^2]."""
CREASE_RAD = 0.3
"""Smallest mean turn of the creases on both sides [rad]."""


def divided(s: Surfaces, labels: np.ndarray) -> tuple[np.ndarray, list[tuple[int, int]]]:
    """Labels (h, w) with such patches divided, and the pairs of patches that are of two things."""
    labels, apart = labels.copy(), list[tuple[int, int]]()
    whole = relations.contacts(s, labels)
    for ledge, patch in sorted({pair for a, b in whole for pair in ((a, b), (b, a))}):
        upper = _upper(s, labels, ledge, patch)
        if upper is not None:
            new = int(labels.max()) + 1
            labels[upper] = new
            apart += [(patch, new), (ledge, new)]
    return labels, apart


def _upper(s: Surfaces, labels: np.ndarray, ledge: int, patch: int) -> np.ndarray | None:
    """Pixels (h, w) bool of a patch that stand on a ledge; None if it is not divided there."""
    top, own = np.flatnonzero(labels == ledge), labels == patch
    if s.pixel_m2.ravel()[top].sum() < LEDGE_M2 or not own.any():
        return None
    group = relations.describe(s, top, 0.0)
    if abs(float(group.plane[0][2])) < LEVEL:
        return None
    # A small ledge tilts with the noise; level is the better guess some way from it.
    above = own & (s.points[..., 2] > group.middle[2])
    sides = above, own & ~above
    if min(float(s.pixel_m2[side].sum()) for side in sides) < LEAST_M2:
        return None
    trial = np.zeros_like(labels)
    trial.ravel()[top] = 1
    trial[above], trial[sides[1]] = 2, 3
    contacts = relations.contacts(s, trial)
    concave, convex = _turn(contacts, 2), _turn(contacts, 3)
    likeness = relations.likeness(s, *(relations.describe(s, np.flatnonzero(side), 0.0) for side in sides))
    creased = concave < -CREASE_RAD and convex > CREASE_RAD
    return above if creased and likeness < relations.SAME_COLOUR else None


def _turn(contacts: dict[tuple[int, int], relations.Contact], side: int) -> float:
    """Mean signed angle of the crease between label 1 and another one [rad]; 0 if they hardly meet."""
    contact = contacts.get((1, side), relations.Contact())
    return contact.turn / contact.meeting if contact.meeting >= FEWEST else 0.0
