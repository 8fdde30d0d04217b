"""Scripted operator of primitive `push`: fingertips behind the object move it straight to its target."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import lie, transforms
from dextera_build.sim.control.operator import State
from dextera_build.sim.experts.candidates import (
    ABOVE_M,
    LEANS,
    PITCHES,
    TURNS,
    Expert,
    Search,
    comfortable,
    mixed,
    pushing,
)
from dextera_build.sim.experts.motion import Leg, minimum_jerk
from dextera_build.sim.experts.pushing import Pushing, Stroke
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.experts.rehearse import Candidate
from dextera_build.sim.primitives.push.primitive import PushGoal
from dextera_build.sim.runtime.environment import Environment

SPEED_M_S = 0.12
"""Speed of the push; at low speed the object stops with the hand [m/s]."""


@dataclass(frozen=True)
class Slide(Stroke):
    """A push along the support."""

    low: float = 0.35
    """Height of the fingertips, as a fraction of the object's; a low contact prevents tipping."""
    seconds: tuple[float, float, float, float] = (1.4, 0.7, 0.5, 1.0)
    """Durations: over, down behind, touch, rest at the target [s]."""


class Push(Pushing):
    """Pushes the task's object to its target.

    Args:
        environment: The task; only its data are used.
        reach: Kinematics of a limb.
        stroke: Parameters of the push.
    """

    def __init__(self, environment: Environment, reach: Reach, stroke: Slide) -> None:
        super().__init__(environment, reach)
        task, bundle = environment.task, environment.bundle
        goal: PushGoal = environment.primitive.goal
        self._target = (self._base_from_world @ [*goal.place_m, 0.0, 1.0])[:3]
        self._points = bundle.objects[task.object].points.astype(np.float64)
        self.stroke = stroke

    def legs(self, state: State) -> list[Leg]:
        """The plan from `state`."""
        stroke, pose = self.stroke, state.objects[self._object]
        way = self._target - pose[:3, 3]
        way -= self._up * (way @ self._up)
        far = float(np.linalg.norm(way))
        ahead = way / max(far, 1e-9)
        surface = transforms.apply(pose, self._points)
        heights = surface @ self._up
        turn = self._orientation(ahead)
        low = float(heights.min() + max(stroke.low * np.ptp(heights), self._hand.height(turn, self._up)))
        # A slanted or hollow side is touched later than the object's rearmost point.
        meets = self._hand.meets(turn, ahead, self._up, surface - pose[:3, 3])
        start = pose[:3, 3] + ahead * meets + self._up * (low - pose[:3, 3] @ self._up)

        def palm(along: float, up: float = 0.0) -> np.ndarray:
            return self._hand.palm(turn, start + ahead * along + self._up * up)

        over, down, touch, rest = stroke.seconds
        legs = [
            Leg(palm(-stroke.clear_m, stroke.above_m), self._hand.fingers, over, "approach"),
            Leg(palm(-stroke.clear_m), self._hand.fingers, down, "reach", self._object),
            self._pushes(palm(0.0), touch),
        ]
        # The peak speed of a minimum-jerk motion is 15/8 of its mean.
        steps = max(2, round(15 / 8 * far / SPEED_M_S * self._rate))
        legs += [self._pushes(palm(far * minimum_jerk(step / steps)), 1 / self._rate) for step in range(1, steps + 1)]
        return [*legs, self._pushes(legs[-1].palm, rest)]

    def _orientation(self, ahead: np.ndarray) -> np.ndarray:
        """The palm's rotation in the base: fingers down, tilted and turned, the palm towards the push."""
        facing = lie.rotation(self._up * self.stroke.turn_rad) @ ahead
        pitch = self.stroke.pitch_rad
        up = np.cos(pitch) * self._up + np.sin(pitch) * np.cross(self._up, facing)
        return self._hand.turn(facing, up, self.stroke.lean_rad)


def _slides(search: Search) -> list[Candidate]:
    """Pushes of the task's object along its support, most comfortable first."""
    ways = [
        Slide(lean, turn, pitch, above_m=above)
        for pitch, turn, lean, above in itertools.product(PITCHES, TURNS, LEANS, ABOVE_M)
    ]
    found = (pushing(way, Push(search.environment, search.reach, way)) for way in mixed(ways))
    return comfortable(search, found)


EXPERTS = (Expert("nothing", _slides),)
