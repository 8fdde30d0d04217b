"""Shared by scripted operators: the hand's pose, and whether the arm can follow a plan."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from dextera_build.artifacts.robot import RobotModel
from dextera_build.sim.control.hand import HandKinematics
from dextera_build.sim.control.ik import ArmKinematics
from dextera_build.sim.control.operator import Command, OutOfReach, State
from dextera_build.sim.experts.motion import Leg, sample

POSITION_M = 0.004
"""Position tolerance of a reachable pose [m]."""
ROTATION_RAD = 0.04
"""Rotation tolerance of a reachable pose [rad]."""


class Reach:
    """Kinematics of one limb of a robot for scripted operators.

    Args:
        robot: The embodiment.
        limb: Name of the limb.
    """

    def __init__(self, robot: RobotModel, limb: str) -> None:
        self.limb = limb
        """Name of the limb."""
        self.grips = robot.limbs[limb].grips
        """Ways to use its hand."""
        self.arm = ArmKinematics(robot, limb)
        """Kinematics of the palm."""
        self.fingers = HandKinematics(robot, limb)
        """Kinematics of the fingertips."""
        names = [joint.name for joint in robot.joints]
        self._of_arm = np.array([names.index(name) for name in self.arm.joints])
        self._of_hand = np.array([names.index(name) for name in self.fingers.joints], int)

    def joints(self, state: State) -> np.ndarray:
        """Arm joints (A,) [rad]."""
        return np.asarray(state.joints[self._of_arm])

    def hand(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """T_base_palm (4, 4) and finger joints (H,) [rad]."""
        return self.arm.pose(self.joints(state)), state.joints[self._of_hand]

    def commands(self, legs: Sequence[Leg], state: State, control_hz: float) -> Iterator[Command]:
        """Commands at control rate along a plan from `state`."""
        return sample(self.limb, *self.hand(state), legs, control_hz)

    def check(self, legs: Sequence[Leg], state: State) -> float:
        """Smallest distance to a joint limit along the plan [rad].

        Raises:
            OutOfReach: The arm cannot reach the end of a leg.
        """
        arm, margin = self.joints(state), np.inf
        for leg in legs:
            found = self.arm.solve(leg.palm, arm, posture=self.arm.home)
            if not found.reached(POSITION_M, ROTATION_RAD):
                raise OutOfReach(
                    f"goal out of reach: the hand misses it by {1000 * found.position_error_m:.0f} mm and "
                    f"{np.degrees(found.rotation_error_rad):.0f} deg in `{leg.segment}`"
                )
            arm, margin = found.joints, min(margin, found.margin_rad)
        return float(margin)
