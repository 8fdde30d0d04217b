"""Scripted operator of primitive `lift`: approach, close the hand, raise it."""

from __future__ import annotations

from dextera_build.artifacts.goals import LiftGoal
from dextera_build.sim.control.operator import State
from dextera_build.sim.experts.grasp import Grasp
from dextera_build.sim.experts.motion import Leg
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.experts.scripted import Scripted
from dextera_build.sim.runtime.environment import Environment

MORE_M = 0.03
"""Height by which the object is raised above the task's goal [m]."""


class Lift(Scripted):
    """Grasps and lifts the task's object.

    Args:
        environment: The task; only its data are used.
        reach: Kinematics of its robot.
        grasp: The grasp to execute.
    """

    def __init__(self, environment: Environment, reach: Reach, grasp: Grasp) -> None:
        super().__init__(environment, reach)
        task = environment.task
        assert isinstance(task.goal, LiftGoal)
        self._rise = task.goal.height_m
        self.grasp = grasp

    def legs(self, state: State) -> list[Leg]:
        """The plan from `state`."""
        grasp, base = self.grasp, state.objects[self._object]
        raised = base @ grasp.palm
        raised[:3, 3] += self._up * (self._rise + MORE_M)
        return [
            *grasp.taking(self._object, base, self._up),
            Leg(raised, grasp.closed, grasp.seconds[4], "lift", self._object, True),
            Leg(raised, grasp.closed, grasp.seconds[5], "lift", self._object, True),
        ]
