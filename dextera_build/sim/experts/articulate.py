"""Scripted operator of primitive `articulate`: push the link with the fingertips, along the path of its joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.goals import ArticulateGoal
from dextera_build.geometry import lie, transforms
from dextera_build.sim.control.mechanism import Mechanism
from dextera_build.sim.control.operator import State
from dextera_build.sim.experts.motion import Leg, minimum_jerk
from dextera_build.sim.experts.pushing import Pushing
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.runtime.environment import Environment


@dataclass(frozen=True)
class Push:
    """Parameters of a push, relative to the object's root; the same for every start."""

    lean_rad: float
    """Tilt of the fingers from straight down towards the initial push direction [rad]."""
    turn_rad: float
    """Rotation of the hand about the vertical, from the plane of the push [rad]."""
    pitch_rad: float = 0.0
    """Rotation of the hand about the initial push direction, fingers down at 0 [rad]."""
    share: float = 0.9
    """Distance from the axis, see `Mechanism.pushed_at`; a long lever needs the least force, so that light objects
    stay in place."""
    clear_m: float = 0.06
    """Distance behind the link at which the push begins [m]."""
    press_m: float = 0.008
    """Depth inside the link of the fingertips' target [m]."""
    above_m: float = 0.16
    """Height of the approach above the start of the push [m]."""
    seconds: tuple[float, float, float, float, float] = (1.4, 0.7, 0.4, 1.8, 0.8)
    """Durations: over, down behind, touch, push, press [s]."""


class Articulate(Pushing):
    """Pushes a task's joint to its commanded position.

    Args:
        environment: The task; only its geometry is used.
        reach: Kinematics of its robot.
        push: Parameters of the push.
    """

    def __init__(self, environment: Environment, reach: Reach, push: Push) -> None:
        super().__init__(environment, reach)
        task = environment.task
        assert isinstance(task.goal, ArticulateGoal)
        ((self._joint, self._goal),) = task.goal.joints.items()
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
