"""Scripted operator of primitive `articulate`: push the link with the fingertips, along the path of its joint."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from dextera_build.geometry import lie, transforms
from dextera_build.sim.control.mechanism import Mechanism
from dextera_build.sim.control.operator import State
from dextera_build.sim.experts.candidates import (
    ABOVE_M,
    LEANS,
    LOOKED,
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
from dextera_build.sim.primitives.articulate.primitive import ArticulateGoal
from dextera_build.sim.runtime.environment import Environment

SHARES = (0.95, 0.8)
"""Distances from the axis at which a link is pushed, see `Mechanism.pushed_at`."""
NEAR_M = 0.025
"""Distance behind a link at which a push begins if there is no space for more, as between two links [m]."""


@dataclass(frozen=True)
class Swing(Stroke):
    """A push of a link along the path of its joint, relative to the object's root."""

    share: float = 0.9
    """Distance from the axis, see `Mechanism.pushed_at`; a long lever needs the least force, so that light objects
    stay in place."""
    press_m: float = 0.008
    """Depth inside the link of the fingertips' target [m]."""
    seconds: tuple[float, float, float, float, float] = (1.4, 0.7, 0.4, 1.8, 0.8)
    """Durations: over, down behind, touch, push, press [s]."""


class Articulate(Pushing):
    """Pushes a task's joint to its commanded position.

    Args:
        environment: The task; only its geometry is used.
        reach: Kinematics of its robot.
        push: Parameters of the push.
    """

    def __init__(self, environment: Environment, reach: Reach, push: Swing) -> None:
        super().__init__(environment, reach)
        goal: ArticulateGoal = environment.primitive.goal
        ((self._joint, self._goal),) = goal.joints.items()
        self._mechanism = Mechanism(environment.model, self._joint)
        self.push = push

    def legs(self, state: State) -> list[Leg]:
        """The plan from `state`."""
        push, now = self.push, state.displacement[self._joint]
        base = state.objects[self._object]
        turn = self._orientation(now)
        place, along = self._mechanism.pushed_at(self._goal - now, push.share)
        # The link of a flat object may be lower than fingertips that clear the support, on which the root stands at z =
        # 0.
        low = self._hand.height(turn, np.array([0.0, 0.0, 1.0]))

        def palm(position: float, gap: float, up: float = 0.0) -> np.ndarray:
            link = self._mechanism.pose(position)
            before = self._hand.ahead(turn, link[:3, :3] @ along)
            tip = transforms.apply(link, place - along * (gap + before))
            tip[2] = max(tip[2], low) + up
            return np.asarray(base @ self._hand.palm(turn, tip))

        over, down, touch, sweep, press = push.seconds
        legs = [
            Leg(palm(now, push.clear_m, push.above_m), self._hand.fingers, over, "approach"),
            # In the object's frame, so that a synthesised episode approaches from the same side (Eq. 4a).
            Leg(palm(now, push.clear_m), self._hand.fingers, down, "reach", self._object),
            self._pushes(palm(now, 0.0), touch),
        ]
        steps = max(2, round(sweep * self._rate))
        for step in range(1, steps + 1):
            part = minimum_jerk(step / steps)
            legs.append(self._pushes(palm(now + part * (self._goal - now), -push.press_m * part), 1 / self._rate))
        return [*legs, self._pushes(legs[-1].palm, press)]

    def _orientation(self, now: float) -> np.ndarray:
        """The palm's rotation in the object's root: fingers down, tilted and turned, palm towards the push."""
        _, along = self._mechanism.pushed_at(self._goal - now, 1.0)
        up = np.array([0.0, 0.0, 1.0])
        ahead = self._mechanism.pose(now)[:3, :3] @ along
        ahead -= up * ahead[2]
        ahead = lie.rotation(up * self.push.turn_rad) @ ahead / np.linalg.norm(ahead)
        pitch = self.push.pitch_rad
        up = np.cos(pitch) * up + np.sin(pitch) * np.cross(up, ahead)
        return self._hand.turn(ahead, up, self.push.lean_rad)


def _swings(search: Search) -> list[Candidate]:
    """Pushes of the task's joint, most comfortable first."""
    ways = [
        Swing(lean, turn, pitch, share=share, above_m=above)
        for pitch, turn, lean, share, above in itertools.product(PITCHES, TURNS, LEANS, SHARES, ABOVE_M)
    ]
    far, near = mixed(ways), mixed([replace(way, clear_m=NEAR_M) for way in ways])
    half = LOOKED // 2
    ordered = [*far[:half], *near, *far[half:]]
    found = (pushing(way, Articulate(search.environment, search.reach, way), f" at {way.share:.0%}") for way in ordered)
    return comfortable(search, found)


EXPERTS = (Expert("nothing", _swings),)
