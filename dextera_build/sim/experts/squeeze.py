"""Two-handed grasps: the fingertips of two hands press on opposite sides of an object."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import transforms
from dextera_build.sim.experts.motion import Leg, shifted
from dextera_build.sim.experts.pushing import Pushed
from dextera_build.sim.experts.reach import Reach

UP = np.array([0.0, 0.0, 1.0])
CLEAR_M = 0.06
"""Distance from the object at which the hands wait next to it [m]."""
PRESS_M = 0.07
"""Distance that the hands advance after contact [m]."""
ABOVE_M = (0.14, 0.06)
"""Heights of the approach above that; hands with fingers down rise less [m]."""
BESIDE_M = 0.035
"""Half width of the strip across the object in which its width is measured [m]."""
SECONDS = (1.4, 0.8, 0.7, 0.6, 1.6, 0.8)
"""Durations: over, down, near, press, lift, hold [s]."""


@dataclass(frozen=True)
class Side:
    """One hand of a squeeze, relative to the object."""

    palm: np.ndarray
    """(4, 4) T_object_palm when its fingertips touch."""
    away: np.ndarray
    """Offset (3,) to the waiting position of the hand, in the object's frame [m]."""
    fingers: np.ndarray
    """(H,) finger joints [rad]."""


@dataclass(frozen=True)
class Squeeze:
    """Contact poses of two hands; the same for every start."""

    sides: Mapping[str, Side]
    """Limb -> its side."""
    name: str
    """Human-readable description."""
    way: str
    """Kind of squeeze."""
    above_m: float
    """Height of the approach above the waiting positions [m]."""

    def lifting(self, name: str, base: np.ndarray, up: np.ndarray, rise_m: float) -> dict[str, list[Leg]]:
        """The approach to both sides, and the lift.

        Args:
            name: Body of the object.
            base: T_base_object (4, 4).
            up: (3,) vertical in the base.
            rise_m: Height of the lift [m].
        """
        plan = {}
        over, down, near, press, lift, _ = SECONDS
        for limb, side in self.sides.items():
            touch = base @ side.palm
            away = base[:3, :3] @ side.away
            wait = shifted(touch, away)
            pressed = shifted(touch, -away / np.linalg.norm(away) * PRESS_M)
            plan[limb] = [
                Leg(shifted(wait, up * self.above_m), side.fingers, over, "approach", arc_m=0.05),
                Leg(wait, side.fingers, down, "reach", name),
                Leg(touch, side.fingers, near, "grasp", name, True),
                Leg(pressed, side.fingers, press, "grasp", name, True),
                Leg(shifted(pressed, up * rise_m), side.fingers, lift, "lift", name, True),
            ]
        return plan


def squeezes(points: np.ndarray, reach: Reach, places: Mapping[str, np.ndarray]) -> Iterator[Squeeze]:
    """Ways for two limbs to hold an upright object between them.

    Args:
        points: (P, 3) on its surface, in its frame, z up [m].
        reach: Kinematics of the limbs.
        places: Limb -> position (3,) of its palm in the object's frame; every hand uses its own side.
    """
    hands = {limb: Pushed(reach.one(limb)) for limb in reach.limbs}
    top = float(points[:, 2].max())
    for height in sorted({max(part * top, 0.016) for part in (0.5, 0.7)}):
        for turn in np.arange(12) * np.pi / 12:
            across = np.array([np.cos(turn), np.sin(turn), 0.0])
            ends = _ends(points, height, across)
            if ends is None:
                continue
            one, other = reach.limbs
            if (places[one] - places[other]) @ across < 0:
                one, other = other, one
            for pitch in (0.0, 0.5, -0.5, 0.8, -0.8, 1.1, -1.1, 1.4, -1.4):
                sides = {
                    one: _side(hands[one], ends[1], -across, pitch),
                    other: _side(hands[other], ends[0], across, -pitch),
                }
                label = f"both hands at {1000 * height:.0f} mm, across {np.degrees(turn):.0f} deg"
                for above in ABOVE_M:
                    said = f"{label}, pitch {np.degrees(pitch):.0f} deg, from {1000 * above:.0f} mm above"
                    yield Squeeze(sides, said, f"across {np.degrees(turn) // 30:.0f}", above)


def _side(hand: Pushed, touch: np.ndarray, facing: np.ndarray, pitch: float) -> Side:
    """The hand that presses at `touch` (3,) towards `facing` (3,), fingers down, pitched about `facing`."""
    along = np.cos(pitch) * UP + np.sin(pitch) * np.cross(UP, facing)
    turn = hand.turn(facing, along, 0.0)
    raised = touch + UP * max(0.0, hand.height(turn, UP) - touch[2])
    palm = hand.palm(turn, raised - facing * hand.ahead(turn, facing))
    return Side(palm, -facing * CLEAR_M, hand.fingers)


def _ends(points: np.ndarray, height: float, across: np.ndarray) -> Sequence[np.ndarray] | None:
    """Both intersections (3,) of a line through the object's centre along `across` with its surface at a height [m]."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    local = points - np.array([middle[0], middle[1], height])
    strip = np.abs(local @ np.cross(UP, across)) < BESIDE_M
    level = strip & (np.abs(local[:, 2]) < 0.02)
    if level.sum() < 4:
        return None
    along = local[level] @ across
    base = np.array([middle[0], middle[1], height])
    return base + across * float(along.min()), base + across * float(along.max())


def in_object(base: np.ndarray, palms: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Limb -> position (3,) of its palm (4, 4) in the frame of an object at `base` (4, 4)."""
    inverse = transforms.invert(base)
    return {limb: transforms.apply(inverse, palm[:3, 3]) for limb, palm in palms.items()}
