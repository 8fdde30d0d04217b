"""Whether a plan's poses are reached without touching what is not meant to be touched."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from dextera_build.geometry import quaternions
from dextera_build.sim.compose import ROBOT
from dextera_build.sim.environment import Environment
from dextera_build.sim.operator import State
from dextera_build.sim.scripts.motion import Leg
from dextera_build.sim.scripts.reach import Reach

ENOUGH_RAD = 0.35
"""More distance than this to the joint limits is no more comfortable [rad]."""
TOUCH_M = 0.004
"""How deep the task's object may reach into the hand where contact is meant [m]."""


class Room:
    """Checks poses against the collision shapes of a task's model.

    Args:
        environment: The task; only its model is used.
        reach: Kinematics of its robot.
    """

    def __init__(self, environment: Environment, reach: Reach) -> None:
        self._model, self._reach = environment.model, reach
        self._data = mujoco.MjData(self._model)
        if self._model.nkey:
            mujoco.mj_resetDataKeyframe(self._model, self._data, 0)
        self._base = environment.bundle.world_from_base
        roots = self._model.body_rootid[self._model.geom_bodyid]
        self._robot = roots == self._model.body(ROBOT + "base").id
        self._object = roots == self._model.body(environment.task.object).id
        self._arm = self._addresses(reach.arm.joints)
        self._fingers = self._addresses(reach.fingers.joints)

    def comfort(self, legs: Sequence[Leg], state: State) -> float | None:
        """How comfortable the arm is along a plan, the more the better; None where it does not reach or has no room.

        Args:
            legs: The plan.
            state: Where the objects are.
        """
        self._place(state)
        arm = self._reach.arm
        seed: np.ndarray | None = None
        margin, far = np.inf, 0.0
        first = next(number for number, leg in enumerate(legs) if leg.contact)
        # What fails most often comes first: taking hold, then the way there. Afterwards the object moves along.
        for leg in (legs[first], *reversed(legs[:first]), legs[-1]):
            solved = arm.solve(leg.palm, seed, restarts=1 if seed is None else 0, posture=arm.home)
            if not solved.reached():
                return None
            if leg is not legs[-1] and not self._free(solved.joints, leg):
                return None
            seed = solved.joints
            margin, far = min(margin, solved.margin_rad), max(far, float(np.abs(seed - arm.home).max()))
        return 3.0 * min(margin, ENOUGH_RAD) - far

    def _place(self, state: State) -> None:
        for name, pose in state.objects.items():
            world = self._base @ pose
            place = self._data.joint(name).qpos
            place[:3], place[3:] = world[:3, 3], quaternions.from_matrix(world[:3, :3])
        for name, position in state.displacement.items():
            self._data.joint(name).qpos[0] = position

    def _free(self, joints: np.ndarray, leg: Leg) -> bool:
        model, data = self._model, self._data
        data.qpos[self._arm], data.qpos[self._fingers] = joints, leg.fingers
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        for contact in data.contact[: data.ncon]:
            one, other = contact.geom
            if not (self._robot[one] or self._robot[other]):
                continue
            meant = leg.contact and (self._object[one] or self._object[other])
            if contact.dist < -(TOUCH_M if meant else 0.0):
                return False
        return True

    def _addresses(self, names: Sequence[str]) -> np.ndarray:
        return np.array([self._model.joint(ROBOT + name).qposadr[0] for name in names])

