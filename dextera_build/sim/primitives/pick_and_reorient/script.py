"""Scripted operator of primitive `pick_and_reorient`: grasp, raise, move to the target pose, hold."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dextera_build.geometry import quaternions
from dextera_build.sim.control.operator import BASE, FREE, State
from dextera_build.sim.experts.candidates import Expert, Search, grasps
from dextera_build.sim.experts.grasp import Grasp
from dextera_build.sim.experts.motion import Leg, Plan, shifted
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.experts.rehearse import Candidate
from dextera_build.sim.experts.scripted import Taking
from dextera_build.sim.primitives.pick_and_reorient.primitive import ReorientGoal
from dextera_build.sim.runtime.environment import Environment

RAISED_M = 0.12
"""Height to which the object is raised before its rotation, and at which it stays if no position is commanded [m]."""
SECONDS = (1.0, 2.0, 1.0)
"""Durations: lift, turn, hold [s]."""


class Reorient(Taking):
    """Grasps the task's object and holds it at its target pose.

    Args:
        environment: The task; only its data are used.
        reach: Kinematics of a limb.
        grasp: The grasp to execute.
    """

    def __init__(self, environment: Environment, reach: Reach, grasp: Grasp) -> None:
        super().__init__(environment, reach)
        self._goal: ReorientGoal = environment.primitive.goal
        self.grasp = grasp

    def taking(self, state: State) -> Plan:
        """The grasp and the lift."""
        base = state.objects[self._object]
        raised = shifted(base @ self.grasp.palm, self._up * RAISED_M)
        legs = self.grasp.taking(self._object, base, self._up)
        return {self._reach.limb: [*legs, self._held(raised, self.grasp.closed, SECONDS[0], "lift")]}

    def going_on(self, state: State, base: np.ndarray, last: Mapping[str, Leg], held: Mapping[str, np.ndarray]) -> Plan:
        """The motion to the target, and the hold."""
        target = shifted(base, self._up * RAISED_M)
        if self._goal.quaternion is not None:
            target[:3, :3] = self._base_from_world[:3, :3] @ quaternions.to_matrix(np.array(self._goal.quaternion))
        if self._goal.place_m is not None:
            target[:3, 3] = (self._base_from_world @ [*self._goal.place_m, 1.0])[:3]
        palm = target @ held[self._reach.limb]
        _, turn, hold = SECONDS
        legs = [
            self._held(palm, self.grasp.closed, turn, "turn", FREE),
            self._held(palm, self.grasp.closed, hold, "turn", BASE),
        ]
        return {self._reach.limb: legs}


def _reorients(search: Search) -> list[Candidate]:
    """Grasps of the task's object to hold it at its target pose."""
    return grasps(search, lambda grasp: Reorient(search.environment, search.reach, grasp))


EXPERTS = (Expert("thumb", _reorients),)
