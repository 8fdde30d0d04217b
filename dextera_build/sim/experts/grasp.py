"""A grasp, and the approach to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.sim.experts.motion import Leg


@dataclass(frozen=True)
class Grasp:
    """A grasp relative to the object; the same for every start."""

    palm: np.ndarray
    """(4, 4) T_object_palm when the fingers close."""
    away: np.ndarray
    """(3,) offset from there to the hand's waiting position, in the object's frame [m]."""
    open: np.ndarray
    """(H,) finger joints before closing [rad]."""
    closed: np.ndarray
    """(H,) targets of the pressing finger joints [rad]."""
    aside_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Offset of the palm before closing, in the object's frame, if one finger alone moves: the other is clear [m]."""
    name: str = ""
    """Human-readable description."""
    way: str = ""
    """Kind of grasp; grasps of one kind differ in details."""
    wall: np.ndarray | None = None
    """(3,) middle of the wall that is pinched, in the object's frame [m]; None: the whole object is held."""
    above_m: float = 0.08
    """Height of the approach above the waiting position [m]."""
    aside: float = 1.0
    """Offset from the grasp at that height, as a multiple of `away`."""
    arc_m: float = 0.08
    """Height of the approach's midpoint above the straight line [m]."""
    seconds: tuple[float, float, float, float, float, float] = (1.3, 0.5, 0.6, 0.6, 1.2, 0.8)
    """Durations: over, down, near, close, lift, hold [s]."""

    def taking(self, name: str, base: np.ndarray, up: np.ndarray) -> list[Leg]:
        """The approach to the object and the grasp.

        Args:
            name: Body of the object.
            base: T_base_object (4, 4).
            up: (3,) vertical in the base.
        """
        hold = base @ self.palm
        near = hold.copy()
        near[:3, 3] += base[:3, :3] @ self.aside_m
        over, wait = near.copy(), near.copy()
        wait[:3, 3] += base[:3, :3] @ self.away
        over[:3, 3] = wait[:3, 3] + (up * self.above_m + base[:3, :3] @ self.away * self.aside)
        return [
            Leg(over, self.open, self.seconds[0], "approach", arc_m=self.arc_m),
            # In the object's frame, so that a synthesised episode approaches from the same side (Eq. 4a).
            Leg(wait, self.open, self.seconds[1], "reach", name),
            Leg(near, self.open, self.seconds[2], "grasp", name, True),
            Leg(hold, self.closed, self.seconds[3], "grasp", name, True),
        ]
