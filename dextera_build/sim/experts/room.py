"""Check whether the arm can follow a plan without collisions."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import mujoco
import numpy as np

from dextera_build.geometry import quaternions
from dextera_build.sim.control.operator import Command, State
from dextera_build.sim.experts.motion import Leg
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.runtime.environment import Environment

ENOUGH_RAD = 0.35
"""Distance to the joint limits beyond which comfort no longer increases [rad]."""
TOUCH_M = 0.004
"""Allowed penetration between hand and task object during intended contact [m]."""
CLEAR_M = 0.010
"""Clearance of the robot from everything else [m]."""
EVERY = 2
"""Control steps between collision checks along a plan."""


class Room:
    """Checks plans against the collision shapes of a task's model; objects do not move.

    Args:
        environment: The task; only its model is used.
        reach: Kinematics of a limb of its robot; the other limbs stay at home.
    """

    def __init__(self, environment: Environment, reach: Reach) -> None:
        model = copy.copy(environment.model)
        self._model, self._reach, self._rate = model, reach, environment.task.control_hz
        self._data = mujoco.MjData(model)
        if model.nkey:
            mujoco.mj_resetDataKeyframe(model, self._data, 0)
        self._base = environment.bundle.base_pose.matrix
        roots = model.body_rootid[model.geom_bodyid]
        self._robot = roots == model.body(ROBOT + "base").id
        self._object = roots == model.body(environment.task.object).id
        # Contacts are reported from this distance.
        model.geom_margin[self._robot] = CLEAR_M
        self._arm = self._addresses(reach.arm.joints)
        self._fingers = self._addresses(reach.fingers.joints)
        own = {*reach.arm.joints, *reach.fingers.joints}
        self._led = [each for each in environment.bundle.robot.followers if each.leader in own]

    def comfort(self, legs: Sequence[Leg], state: State) -> float | None:
        """Comfort of the arm along a plan, higher is better; None if unreachable or in collision.

        Args:
            legs: The plan.
            state: Poses of the robot and the objects.
        """
        self._place(state)
        arm = self._reach.arm
        seed: np.ndarray | None = None
        margin, far = np.inf, 0.0
        first = next(number for number, leg in enumerate(legs) if leg.contact)
        # The most frequent failures first: the grasp, then the approach, then the end.
        for leg in (legs[first], *reversed(legs[:first]), legs[-1]):
            solved = arm.solve(leg.palm, seed, restarts=1 if seed is None else 0, posture=arm.home)
            if not solved.reached():
                return None
            if leg.contact and leg is legs[first] and not self._free(solved.joints, leg.fingers, touching=True):
                return None
            seed = solved.joints
            margin, far = min(margin, solved.margin_rad), max(far, float(np.abs(seed - arm.home).max()))
        return 3.0 * min(margin, ENOUGH_RAD) - far if self._clear(legs, state) else None

    def _clear(self, legs: Sequence[Leg], state: State) -> bool:
        """Whether the arm's path is free of collisions until the object moves."""
        arm, joints = self._reach.arm, self._reach.joints(state)
        # After the approach the object moves with the hand, which only a rehearsal can check.
        near = next(number for number, leg in enumerate(legs) if leg.contact) + 1
        commands: list[Command] = list(self._reach.commands(legs[:near], state, self._rate))
        for number, command in enumerate(commands):
            aim = command.aims[self._reach.limb]
            joints = arm.track(aim.palm, joints, 1.0 / self._rate)
            looked = number % EVERY == 0 or number == len(commands) - 1
            if looked and not self._free(joints, aim.fingers, touching=command.contact):
                return False
        return True

    def _place(self, state: State) -> None:
        for name, pose in state.objects.items():
            world = self._base @ pose
            place = self._data.joint(name).qpos
            place[:3], place[3:] = world[:3, 3], quaternions.from_matrix(world[:3, :3])
        for name, position in state.displacement.items():
            self._data.joint(name).qpos[0] = position

    def _free(self, joints: np.ndarray, fingers: np.ndarray, *, touching: bool) -> bool:
        model, data = self._model, self._data
        data.qpos[self._arm], data.qpos[self._fingers] = joints, fingers
        for each in self._led:
            leader = float(data.joint(ROBOT + each.leader).qpos[0])
            data.joint(ROBOT + each.name).qpos[0] = each.ratio * leader + each.offset
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        for contact in data.contact[: data.ncon]:
            one, other = contact.geom
            if not (self._robot[one] or self._robot[other]):
                continue
            apart = CLEAR_M
            if self._robot[one] and self._robot[other]:
                apart = 0.0
            elif touching and (self._object[one] or self._object[other]):
                apart = -TOUCH_M
            if contact.dist < apart:
                return False
        return True

    def _addresses(self, names: Sequence[str]) -> np.ndarray:
        return np.array([self._model.joint(ROBOT + name).qposadr[0] for name in names], int)
