"""Operators that move a robot by hand poses: the common interface of teleoperation devices, scripts and recordings.

Once per control step an operator receives a `State` and returns a `Command`: target poses of the palm and the fingers.
A `PoseControl` converts it to joint targets, so every operator drives every robot with an arm and a hand.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dextera_build.artifacts.robot import RobotModel
from dextera_build.geometry import transforms
from dextera_build.sim.control.ik import ArmKinematics


@dataclass(frozen=True)
class State:
    """An operator's observation at one control step."""

    joints: np.ndarray
    """(A,) measured joint positions, in the robot's order [rad]."""
    objects: Mapping[str, np.ndarray]
    """Body -> (4, 4) T_base_object."""
    displacement: Mapping[str, float]
    """Joint of an object -> position [rad or m]."""


@dataclass(frozen=True)
class Command:
    """An operator's command at one control step."""

    palm: np.ndarray
    """(4, 4) T_base_palm."""
    fingers: np.ndarray
    """(H,) targets of the hand's joints, in the robot's order [rad]."""
    segment: str
    """Part of the demonstration: `approach`, `grasp`, `lift`, ..."""
    frame: str = ""
    """The body that the palm moves relative to; empty: free motion."""
    contact: bool = False
    """Whether contact of the hand with the task's object is intended."""


class OutOfReach(Exception):  # noqa: N818  a verdict on a start, not a fault
    """The operator cannot do the task from this start; the text is the recorded reason."""


class Operator(Protocol):
    """A source of hand commands."""

    def begin(self, state: State) -> None:
        """Prepare for an episode that starts in `state`.

        Raises:
            OutOfReach: The task cannot be done from this start.
        """

    def command(self, state: State) -> Command | None:
        """The next command; None after the last one."""


class PoseControl:
    """Joint targets from commands: differential inverse kinematics for the arm, commanded positions for the fingers.

    Targets follow the commands, not the measured joints, so contact forces cause no drift.

    Args:
        robot: The embodiment.
        control_hz: Control rate [Hz].
    """

    def __init__(self, robot: RobotModel, control_hz: float) -> None:
        self.arm = ArmKinematics(robot)
        """Kinematics of the palm."""
        names = [joint.name for joint in robot.joints]
        self._arm = np.array([names.index(name) for name in self.arm.joints])
        self._hand = np.array([names.index(name) for name in robot.names("hand")])
        self._lower = np.array([joint.lower for joint in robot.joints])
        self._upper = np.array([joint.upper for joint in robot.joints])
        self._speed = np.array([joint.velocity for joint in robot.joints])
        self._dt = 1.0 / control_hz
        self._targets = np.array([joint.home for joint in robot.joints])

    def begin(self, joints: np.ndarray) -> None:
        """Start from joint targets (A,) [rad]."""
        self._targets = np.array(joints, np.float64)

    def follow(self, command: Command) -> np.ndarray:
        """Joint targets (A,) for the next control step [rad], within position and speed limits."""
        targets = self._targets.copy()
        targets[self._arm] = self.arm.track(command.palm, targets[self._arm], self._dt)
        step = self._speed[self._hand] * self._dt
        old = self._targets[self._hand]
        targets[self._hand] = np.clip(command.fingers, old - step, old + step)
        self._targets = np.clip(targets, self._lower, self._upper)
        return self._targets.copy()

    def lag_m(self, command: Command) -> float:
        """Distance between the commanded palm and its position at the targets [m]."""
        reached = self.arm.pose(self._targets[self._arm])
        return float(np.linalg.norm((transforms.invert(reached) @ command.palm)[:3, 3]))
