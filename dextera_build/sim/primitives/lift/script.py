"""Scripted operators of primitive `lift`: approach, close the hand, raise it; with one hand or two."""

from __future__ import annotations

from dextera_build.sim.control.operator import State
from dextera_build.sim.experts.candidates import Expert, Search, grasps, together
from dextera_build.sim.experts.grasp import Grasp
from dextera_build.sim.experts.motion import Leg, Plan
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.experts.rehearse import Candidate
from dextera_build.sim.experts.rims import Rims, by_rims
from dextera_build.sim.experts.scripted import Scripted
from dextera_build.sim.experts.squeeze import SECONDS, Squeeze
from dextera_build.sim.primitives.lift.primitive import LiftGoal
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
        goal: LiftGoal = environment.primitive.goal
        self._rise = goal.height_m
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


class LiftTogether(Scripted):
    """Lifts the task's object between two hands.

    Args:
        environment: The task; only its data are used.
        reach: Kinematics of both limbs.
        way: Contact poses of the hands, on opposite sides or at the rim.
    """

    def __init__(self, environment: Environment, reach: Reach, way: Squeeze | Rims) -> None:
        super().__init__(environment, reach)
        goal: LiftGoal = environment.primitive.goal
        self._rise = goal.height_m + MORE_M
        self.way = way

    def phases(self, state: State) -> list[Plan]:
        """The plan from `state`."""
        plan = self.way.lifting(self._object, state.objects[self._object], self._up, self._rise)
        for limb, legs in plan.items():
            last = legs[-1]
            plan[limb] = [*legs, Leg(last.palm, last.fingers, SECONDS[5], "lift", self._object, True)]
        return [plan]

    def legs(self, state: State) -> list[Leg]:
        """The legs of the first limb."""
        return list(self.phases(state)[0][self._reach.limb])


def _lifts(search: Search) -> list[Candidate]:
    """Grasps of the task's object to lift it."""
    return grasps(search, lambda grasp: Lift(search.environment, search.reach, grasp))


def _lifts_together(search: Search) -> list[Candidate]:
    """Two-handed grasps on opposite sides of the task's object to lift it."""
    return together(search, lambda way: LiftTogether(search.environment, search.reach, way))


def _lifts_by_rims(search: Search) -> list[Candidate]:
    """Two-handed grasps of the rim of a vessel to lift it."""
    return by_rims(search, lambda way: LiftTogether(search.environment, search.reach, way))


EXPERTS = (
    Expert("thumb", _lifts),
    Expert("nothing", _lifts_by_rims, hands=2),
    Expert("nothing", _lifts_together, hands=2),
)
