"""Scripted operator of primitive `lift`: approach, close the hand, raise it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.goals import LiftGoal
from dextera_build.sim.control.operator import Command, State
from dextera_build.sim.experts.motion import Leg
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.runtime.environment import Environment

MORE_M = 0.03
"""Height by which the object is raised beyond the task's goal [m]."""


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
    name: str = ""
    """Human-readable description."""
    way: str = ""
    """Kind of grasp; grasps of one kind differ in detail."""
    above_m: float = 0.08
    """Height of the approach above the waiting position [m]."""
    aside: float = 1.0
    """Offset from the grasp at that height, as a multiple of `away`."""
    arc_m: float = 0.08
    """Height of the approach's midpoint above the straight line [m]."""
    seconds: tuple[float, float, float, float, float, float] = (1.3, 0.5, 0.6, 0.6, 1.2, 0.8)
    """Durations: over, down, near, close, lift, hold [s]."""


class Lift:
    """Grasps and lifts the task's object.

    Args:
        environment: The task; only its data are used.
        reach: Kinematics of its robot.
        grasp: The grasp to execute.
    """

    def __init__(self, environment: Environment, reach: Reach, grasp: Grasp) -> None:
        task = environment.task
        assert isinstance(task.goal, LiftGoal)
        self._object, self._rate, self._rise = task.object, task.control_hz, task.goal.height_m
        self._up = environment.bundle.base_pose.matrix[2, :3].copy()
        self._reach, self.grasp = reach, grasp
        self._commands: Iterator[Command] = iter(())

    def begin(self, state: State) -> None:
        """Plan from `state`."""
        legs = self.legs(state)
        self._reach.check(legs, state)
        self._commands = self._reach.commands(legs, state, self._rate)

    def command(self, state: State) -> Command | None:
        """The next step of the plan."""
        return next(self._commands, None)

    def legs(self, state: State) -> list[Leg]:
        """The plan from `state`."""
        grasp, base = self.grasp, state.objects[self._object]
        hold = base @ grasp.palm
        wait = hold.copy()
        wait[:3, 3] += base[:3, :3] @ grasp.away
        over, raised = wait.copy(), hold.copy()
        over[:3, 3] += self._up * grasp.above_m + base[:3, :3] @ grasp.away * grasp.aside
        raised[:3, 3] += self._up * (self._rise + MORE_M)
        seconds = grasp.seconds
        return [
            Leg(over, grasp.open, seconds[0], "approach", arc_m=grasp.arc_m),
            # In the object's frame: a synthesised episode approaches from the same side (Eq. 4a).
            Leg(wait, grasp.open, seconds[1], "reach", self._object),
            Leg(hold, grasp.open, seconds[2], "grasp", self._object, True),
            Leg(hold, grasp.closed, seconds[3], "grasp", self._object, True),
            Leg(raised, grasp.closed, seconds[4], "lift", self._object, True),
            Leg(raised, grasp.closed, seconds[5], "lift", self._object, True),
        ]
