"""Which fingers pinch, with hysteresis, and how far apart the fingertips of the robot then are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.sim.retarget.options import Retargeting


@dataclass(frozen=True)
class Pinch:
    """Fingers that pinch at one message."""

    on: np.ndarray
    """(F - 1,) whether each finger pinches with the thumb."""
    share: np.ndarray
    """(F - 1,) from 0 where a finger leaves to 1 where its skin meets the thumb's."""
    gap_m: np.ndarray
    """(F - 1,) distance between the surfaces of the robot's fingertips [m]."""


class Pinches:
    """The pinches of one hand from message to message.

    Once a finger pinches, the gap of the robot's fingertips falls from that of a hand without pinch at `leave_m` to 0
    at `closed_m`, so that a small opening can be held and no target jumps when the pinch ends.

    Args:
        options: Distances.
        count: Number of fingers but the thumb.
        scale: Metre of the robot's hand per metre of the operator's.
    """

    def __init__(self, options: Retargeting, count: int, scale: float) -> None:
        self._options, self._scale = options, scale
        self._on = np.zeros(count, bool)

    def next(self, apart: np.ndarray, thickness: np.ndarray) -> Pinch:
        """The pinches at distances `apart` (F - 1,) of the operator's tips from the thumb's [m].

        Args:
            apart: Distances [m] of the operator.
            thickness: (F - 1,) distance of the centres of the robot's fingertips when their surfaces meet [m].
        """
        own = self._options
        self._on = np.where(self._on, apart <= own.leave_m, apart < own.enter_m)
        open_share = np.clip((apart - own.closed_m) / (own.leave_m - own.closed_m), 0.0, 1.0)
        widest = np.maximum(self._scale * own.leave_m - thickness, 0.0)
        return Pinch(self._on.copy(), 1.0 - open_share, open_share * widest)
