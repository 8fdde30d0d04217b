"""Hands that push with their fingertips, and operators that repeat pushes until the episode ends."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import transforms
from dextera_build.sim.control.operator import Command, OutOfReach, State
from dextera_build.sim.experts.motion import Leg, Plan, follow, shifted
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.experts.scripted import Scripted
from dextera_build.sim.runtime.environment import Environment

SUPPORT_M = 0.012
"""Clearance between pushing fingertips and the support [m]."""
WIDTH = 1.5
"""Half width of the strip in which a fingertip touches a surface, in fingertip radii."""
AWAY_M, RAISED_M, AWAY_S = 0.03, 0.10, 0.5
"""Retreat before a repeated push: distance backwards and upwards [m], and duration of each [s]."""


@dataclass(frozen=True)
class Stroke:
    """Parameters of a push; the same for every start."""

    lean_rad: float
    """Tilt of the fingers from straight down towards the initial direction of the push [rad]."""
    turn_rad: float
    """Rotation of the hand about the vertical, from palm first [rad]."""
    pitch_rad: float = 0.0
    """Rotation of the hand about the initial direction of the push, fingers down at 0 [rad]."""
    clear_m: float = 0.06
    """Distance behind the surface at which the push begins [m]."""
    above_m: float = 0.16
    """Height of the approach above the start of the push [m]."""


class Pushed:
    """A hand that pushes with its fingertips, from its grip against nothing.

    Args:
        reach: Kinematics of its limb.
    """

    def __init__(self, reach: Reach) -> None:
        grip = next(grip for grip in reach.grips.values() if grip.against == "nothing")
        self.fingers = reach.fingers.posture(grip.open)
        """(H,) finger joints [rad]."""
        self.tip_m = grip.tip_radius_m
        """Radius of a fingertip [m]."""
        self._tips = np.array([reach.fingers.tip(role, self.fingers) for role in reach.fingers.fingers])
        self._pad = self._tips.mean(axis=0)
        # Axes of the hand, in the palm's frame: along the fingers, out of the palm, and across.
        along, out = np.array(grip.pointing), np.array(grip.facing)
        self._axes = np.stack([along, out, np.cross(along, out)])

    def _spread(self, turn: np.ndarray) -> np.ndarray:
        """Fingertips (F, 3) of a palm with rotation `turn` (3, 3), relative to their centre."""
        return np.asarray((self._tips - self._pad) @ turn.T)

    def palm(self, turn: np.ndarray, tip: np.ndarray) -> np.ndarray:
        """Pose (4, 4) of the palm with rotation `turn` (3, 3) and the fingertips at `tip` (3,)."""
        return transforms.rigid(turn, tip - turn @ self._pad)

    def height(self, turn: np.ndarray, up: np.ndarray) -> float:
        """Minimum height [m] of the centre of the fingertips at which the lowest one clears the support.

        Args:
            turn: (3, 3) rotation of the palm.
            up: (3,) vertical in the same frame.
        """
        lowest = float((self._spread(turn) @ up).min())
        return self.tip_m + SUPPORT_M - lowest

    def ahead(self, turn: np.ndarray, way: np.ndarray) -> float:
        """Distance [m] of the foremost fingertip ahead of the centre of the fingertips.

        Args:
            turn: (3, 3) rotation of the palm.
            way: (3,) direction of the push in the same frame.
        """
        return self.tip_m + float((self._spread(turn) @ way).max())

    def meets(self, turn: np.ndarray, way: np.ndarray, up: np.ndarray, surface: np.ndarray) -> float:
        """Distance [m] along the push from the origin to the centre of the fingertips at first contact.

        Args:
            turn: (3, 3) rotation of the palm.
            way: (3,) direction of the push in the same frame.
            up: (3,) vertical in the same frame.
            surface: (N, 3) points of the object, relative to a point on the path of the fingertips' centre.
        """
        tips, across = self._spread(turn), np.cross(up, way)
        beside = np.abs((surface @ across)[None, :] - (tips @ across)[:, None]) < WIDTH * self.tip_m
        gaps = (surface @ way)[None, :] - (tips @ way)[:, None] - self.tip_m
        return float((gaps if not beside.any() else gaps[beside]).min())

    def turn(self, facing: np.ndarray, up: np.ndarray, lean_rad: float) -> np.ndarray:
        """Rotation (3, 3) of the palm: towards `facing` (3,), fingers down, tilted towards it by `lean_rad`."""
        fingers = facing * np.sin(lean_rad) - up * np.cos(lean_rad)
        out = facing * np.cos(lean_rad) + up * np.sin(lean_rad)
        return np.asarray(np.stack([fingers, out, np.cross(fingers, out)], axis=1) @ self._axes)


class Pushing(Scripted):
    """Pushes with the fingertips: over, down behind, touch, many short legs along the path, and a last one.

    Pushes are repeated from the object's current pose until the episode ends, because a pushed object may slip or
    rotate.
    """

    def __init__(self, environment: Environment, reach: Reach) -> None:
        super().__init__(environment, reach)
        self._hand = Pushed(reach)

    def command(self, state: State) -> Command | None:
        """The next step of the plan, or of a new one."""
        command = super().command(state)
        if command is None and self._plan:
            self._commands = self._again(state)
            command = super().command(state)
        return command

    def _again(self, state: State) -> Iterator[Command]:
        """Retreat from the object, upwards, and another push; nothing if out of reach."""
        done = self._plan[self._reach.limb]
        last, way = done[-1].palm, done[2].palm[:3, 3] - done[-2].palm[:3, 3]
        away = shifted(last, AWAY_M * way / max(float(np.linalg.norm(way)), 1e-9))
        up = shifted(away, self._up * RAISED_M)
        legs = self.legs(state)
        plan = {self._reach.limb: legs}
        more = [
            Leg(away, self._hand.fingers, AWAY_S, "push", self._object, True),
            Leg(up, self._hand.fingers, AWAY_S, "approach"),
            *legs,
        ]
        try:
            self._reach.check([self._checked(plan)], state)
        except OutOfReach:
            self._plan = {}
            return iter(())
        self._plan = plan
        hands = {self._reach.limb: (last, self._hand.fingers)}
        return follow({self._reach.limb: more}, hands, self._rate)

    def _checked(self, plan: Plan) -> Plan:
        return {limb: [*legs[:3], *legs[3:-1:8], legs[-1]] for limb, legs in plan.items()}

    def _pushes(self, palm: np.ndarray, seconds: float) -> Leg:
        return Leg(palm, self._hand.fingers, seconds, "push", self._object, True)
