"""Operators that move a robot by hand poses: the common interface of teleoperation devices, scripts and recordings.

Once per control step an operator receives a `State` and returns a `Command`: target poses of palms and fingers, limb by
limb. A `PoseControl` converts it to joint targets, so every operator drives every robot with arms and hands.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import transforms
from dextera_build.sim.control.ik import ArmKinematics

SETTLING = 0.1
"""Part of its distance from home by which the redundancy of an arm returns in a control step, if it is slowed down."""
FREE = ""
"""Frame of free motion, which connects two others."""
BASE = "robot/base"
"""Frame of palm poses that are kept as they are in the robot's base."""


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
class Aim:
    """The target of one limb."""

    palm: np.ndarray
    """(4, 4) T_base_palm."""
    fingers: np.ndarray
    """(H,) targets of the hand's joints, in the limb's order [rad]."""


@dataclass(frozen=True)
class Part:
    """What one limb does in one control step."""

    segment: str
    """See `Command.segment`."""
    frame: str = ""
    """See `Command.frame`."""
    contact: bool = False
    """See `Command.contact`."""


@dataclass(frozen=True)
class Command:
    """An operator's command at one control step."""

    aims: Mapping[str, Aim]
    """Limb -> its target; other limbs hold their position."""
    segment: str
    """Part of the demonstration: `approach`, `grasp`, `lift`, ..."""
    frame: str = ""
    """The body that the palms move relative to, or `BASE`; empty: free motion."""
    contact: bool = False
    """Whether contact of the hands with the task's object is intended."""
    parts: Mapping[str, Part] = field(default_factory=dict)
    """Limb -> what it does, if it does something else; limbs that do the same share one transform of their frame."""

    nears: bool = False
    """Whether a contact is intended soon, before which noise fades."""

    off: Mapping[str, Aim] = field(default_factory=dict)
    """Limb -> the target that is executed in place of its own, in a perturbation; the label stays its own."""

    def part(self, limb: str) -> Part:
        """What a limb does."""
        return self.parts.get(limb) or Part(self.segment, self.frame, self.contact)


class GaveUp(Exception):  # noqa: N818  a verdict on an episode, not a fault
    """The operator ends the episode; the text is the recorded reason."""


class OutOfReach(GaveUp):
    """The task cannot be done from this start."""


class NotHeld(GaveUp):
    """A hand closed on the object, and does not hold it."""


class Operator(Protocol):
    """A source of hand commands."""

    def begin(self, state: State) -> None:
        """Prepare for an episode that starts in `state`.

        Raises:
            OutOfReach: The task cannot be done from this start.
        """

    def command(self, state: State) -> Command | None:
        """The next command; None after the last one.

        Raises:
            GaveUp: Nothing that follows can succeed.
        """


class PoseControl:
    """Joint targets from commands: differential inverse kinematics for arms, commanded positions for fingers.

    Targets follow the commands, not the measured joints, so contact forces cause no drift.

    Args:
        robot: The embodiment.
        control_hz: Control rate [Hz].
        settle_rad_s: Speed at which the redundancy of an arm returns to its home; as far as possible in every step
            by default, which accelerates joints without limit.
        apart_m: Distance that arms keep from the rest of the robot, see `ArmKinematics` [m].
    """

    def __init__(
        self, robot: RobotModel, control_hz: float, settle_rad_s: float = np.inf, apart_m: float = 0.0
    ) -> None:
        self._robot, self._settle, self._apart = robot, settle_rad_s / control_hz, apart_m
        self._names = [joint.name for joint in robot.joints]
        self._arms: dict[tuple[str, ...], ArmKinematics] = {}
        self._hands = {name: self._places(limb.hand) for name, limb in robot.limbs.items()}
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
        targets, arms = self._targets.copy(), self.arms(tuple(command.aims))
        moved = self._places(arms.joints)
        palms = np.array([aim.palm for aim in command.aims.values()])
        targets[moved] = arms.track(palms, targets[moved], self._dt, posture=self.posture(arms, targets[moved]))
        for name, aim in command.aims.items():
            hand = self._hands[name]
            step, old = self._speed[hand] * self._dt, self._targets[hand]
            targets[hand] = np.clip(aim.fingers, old - step, old + step)
        self._targets = np.clip(targets, self._lower, self._upper)
        return self._targets.copy()

    def posture(self, arms: ArmKinematics, joints: np.ndarray) -> np.ndarray:
        """The posture (A,) that the redundancy of arms at joints (A,) tends to in the next step [rad]."""
        if np.isinf(self._settle):
            return arms.home
        return np.asarray(joints + np.clip(SETTLING * (arms.home - joints), -self._settle, self._settle))

    @property
    def targets(self) -> np.ndarray:
        """The last joint targets (A,) [rad]."""
        return self._targets.copy()

    def lag_m(self, command: Command) -> float:
        """Largest distance between a commanded palm and its position at the targets [m]."""
        arms = self.arms(tuple(command.aims))
        reached = arms.poses(self._targets[self._places(arms.joints)])
        pairs = zip(reached, command.aims.values(), strict=True)
        return float(max(np.linalg.norm((transforms.invert(pose) @ aim.palm)[:3, 3]) for pose, aim in pairs))

    def met(self, command: Command) -> list[tuple[str, str]]:
        """Pairs of links that kept the arms of the last command from their targets, see `ArmKinematics.met`."""
        return self.arms(tuple(command.aims)).met

    def arms(self, limbs: tuple[str, ...]) -> ArmKinematics:
        """Kinematics of the palms of some limbs, solved together."""
        if limbs not in self._arms:
            self._arms[limbs] = ArmKinematics(self._robot, limbs, apart_m=self._apart)
        return self._arms[limbs]

    def _places(self, joints: Sequence[str]) -> np.ndarray:
        return np.array([self._names.index(name) for name in joints], int)
