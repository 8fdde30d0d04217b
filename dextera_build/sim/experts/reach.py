"""Shared code of scripted operators: the hands' poses, and reachability of plans."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.sim.control.hand import HandKinematics
from dextera_build.sim.control.ik import ArmKinematics
from dextera_build.sim.control.operator import Command, OutOfReach, State
from dextera_build.sim.experts.motion import Hands, Plan, follow

POSITION_M = 0.004
"""Position tolerance of a reachable pose [m]."""
ROTATION_RAD = 0.04
"""Rotation tolerance of a reachable pose [rad]."""


class Reach:
    """Kinematics of one or several limbs of a robot for scripted operators.

    Args:
        robot: The embodiment.
        limbs: Names of the limbs; methods for one limb use the first.
    """

    def __init__(self, robot: RobotModel, *limbs: str) -> None:
        self.limbs = limbs
        """Names of the limbs."""
        self.limb = limbs[0]
        """The first of them."""
        self.grips = robot.limbs[self.limb].grips
        """Grips of its hand."""
        self.fingers = HandKinematics(robot, self.limb)
        """Kinematics of its fingertips."""
        self.arm = ArmKinematics(robot, limbs)
        """Kinematics of the palms of all limbs."""
        self._robot = robot
        self._names = [joint.name for joint in robot.joints]
        self._of_arm = self.places(self.arm.joints)
        self._parts = {limb: self if len(limbs) == 1 else Reach(robot, limb) for limb in limbs}

    def one(self, limb: str) -> Reach:
        """Kinematics of one of the limbs."""
        return self._parts[limb]

    def some(self, limbs: Sequence[str]) -> Reach:
        """Kinematics of some of the limbs."""
        if tuple(limbs) == self.limbs:
            return self
        return self._parts[limbs[0]] if len(limbs) == 1 else Reach(self._robot, *limbs)

    def places(self, joints: Sequence[str]) -> np.ndarray:
        """Indices of joints in `State.joints`."""
        return np.array([self._names.index(name) for name in joints], int)

    def joints(self, state: State) -> np.ndarray:
        """Arm joints (A,) [rad]."""
        return np.asarray(state.joints[self._of_arm])

    def hands(self, state: State) -> Hands:
        """Palms and finger joints of all limbs."""
        palms = dict(zip(self.limbs, self.arm.poses(self.joints(state)), strict=True))
        return {limb: (palms[limb], state.joints[self.places(one.fingers.joints)]) for limb, one in self._parts.items()}

    def commands(self, plan: Plan, state: State, control_hz: float) -> Iterator[Command]:
        """Commands at control rate along a plan from `state`."""
        return follow(plan, self.hands(state), control_hz)

    def check(self, phases: Sequence[Plan], state: State) -> None:
        """Check that the arms reach the ends of all legs.

        Raises:
            OutOfReach: They cannot.
        """
        joints = state.joints.copy()
        for plan in phases:
            own = self.some(tuple(plan))
            for legs in zip(*plan.values(), strict=True):
                palms = np.array([leg.palm for leg in legs])
                found = own.arm.solve(palms, joints[own._of_arm], posture=own.arm.home)
                if not found.reached(POSITION_M, ROTATION_RAD):
                    raise OutOfReach(
                        f"goal out of reach: the hand misses it by {1000 * found.position_error_m:.0f} mm and "
                        f"{np.degrees(found.rotation_error_rad):.0f} deg in `{legs[0].segment}`"
                    )
                joints[own._of_arm] = found.joints
