"""Moments of inertia of links: those that no rigid body has, and the nearest ones that a body can have."""

from __future__ import annotations

import numpy as np

RADIUS_M = 0.001
"""Radius of the smallest ball that a repaired link's mass may fill [m]; a frame with a mass often has no moments."""
_EXCESS = 1.001
"""Largest moment as a fraction of the sum of the others that passes, for rounded numbers in files."""

_MARGIN, _ROUNDING = 1e-5, 1e-9
"""Part of the largest moment by which the sum of raised ones exceeds it, because MJCF has six digits; part of it that
is a rounding error."""


def fault(mass: float, moments: np.ndarray) -> str:
    """Why no rigid body has this mass [kg] and these principal moments (3,) [kg m^2]; "" if one has.

    Moments of a body are positive, and none exceeds the sum of the other two.
    """
    ordered = np.sort(moments)
    if mass <= 0 or ordered[0] <= 0:
        return f"mass {mass:g} kg and principal moments {listed(ordered)} kg m^2, not all positive"
    if ordered[2] > (ordered[0] + ordered[1]) * _EXCESS + 1e-12:
        return (
            f"principal moments {listed(ordered)} kg m^2, which no body has: the largest exceeds the sum of the others"
        )
    return ""


def repaired(mass: float, moments: np.ndarray) -> np.ndarray:
    """The moments (3,) of a body next to `moments`, in the same order [kg m^2].

    Moments are raised and never lowered, except for two that share what the largest one needs: first to those of a
    ball of `RADIUS_M`, then the smallest, and after it the middle one, until both together are as large as the largest.
    """
    order = np.argsort(moments)
    low, middle, high = np.maximum(np.asarray(moments, np.float64)[order], 0.4 * mass * RADIUS_M**2)
    low = max(low, min(high - middle, high / 2))
    middle = max(middle, high - low)
    made = np.empty(3)
    made[order] = low, middle, high
    return made


def balanced(moments: np.ndarray) -> np.ndarray:
    """`moments` (3,) of which the largest is not above the sum of the others [kg m^2].

    MuJoCo loads no others. What is raised stays below the sum when a file rounds it.
    """
    made, order = np.array(moments, np.float64), np.argsort(moments)
    low, middle, high = made[order]
    if low + middle < high * (1 - _ROUNDING):
        made[order[:2]] += ((1 + _MARGIN) * high - low - middle) / 2
    return made


def listed(values: np.ndarray) -> str:
    """Moments in a message."""
    return " ".join(f"{value:.3g}" for value in values)
