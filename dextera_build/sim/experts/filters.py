"""Filters: limits whose violation discards an episode, checked in every control period."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.sim.control.operator import Command
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.observe.touch import Touch
from dextera_build.sim.runtime.environment import Environment

IMPACT_S = 0.1
"""Time within which an impact is over. A contact is a spring of 50 rad/s or more (`mjcf_contact`), which stops what
falls within a quarter of its period, 31 ms, deeper than it would rest, and pushes it out in about twice that [s]."""


@dataclass(frozen=True)
class Filters:
    """Limits of an episode; those that are infinite or 0 by default are not checked."""

    lag_m: float = 0.02
    """Maximum lag of joint targets behind the commanded palm due to position and speed limits [m]."""
    press_n: float = 1.0
    """Maximum force of an unintended contact [N]."""
    fingers: bool = False
    """Whether parts of hands may touch each other at any time, as a person's do, and not in contact with the task's
    object alone."""
    depth_m: float = np.inf
    """Maximum penetration of the robot, or of an object, into anything [m]; except of an object that the robot does not
    touch, for `IMPACT_S`."""
    grip_m: float = np.inf
    """Maximum penetration where a hand should touch the object [m]."""
    speed: float = np.inf
    """Maximum measured speed of a joint, as a multiple of its own limit."""
    acceleration: float = np.inf
    """Maximum acceleration of the targets sent to an arm's joint, as a multiple of its own limit."""
    hold_s: float = 0.0
    """Time for which success must last, if the task demands less [s]."""


SYNTHESIS = Filters(lag_m=0.02, press_n=2.0, depth_m=0.002, grip_m=0.006, speed=1.1, acceleration=1.0, hold_s=0.5)
"""The defaults of `demonstrate.synthesize`, for rehearsals of what the other world replays."""
SETTLE_RAD_S = 0.08
"""Speed at which redundant joints return to their home in syntheses; a faster return would exceed the limits of
acceleration [rad/s]."""


class Watch:
    """Checks the control periods of episodes.

    Args:
        environment: The task.
    """

    def __init__(self, environment: Environment) -> None:
        self._environment = environment
        self._touch = Touch(environment)
        joints = environment.bundle.robot.joints
        self._names = [joint.name for joint in joints]
        self._limits = np.array([joint.velocity for joint in joints])
        self._accelerations = np.array([joint.acceleration for joint in joints])
        self._arm = np.array([joint.group == "arm" for joint in joints])
        self._dofs = np.array([environment.model.joint(ROBOT + name).dofadr[0] for name in self._names])
        self._sent = [np.zeros(len(joints))] * 3
        # Pairs of bodies without the robot that are too deep now -> number of the first such control period.
        self._falling: dict[tuple[str, str], int] = {}

    def begin(self) -> None:
        """A new episode; the robot rests at the targets of its start."""
        self._sent = [self._environment.previous_action] * 3
        self._falling = {}

    def fault(self, command: Command, lag_m: float, limits: Filters, near: str = "") -> str:
        """The first violation in the control period that has just ended; empty if there is none.

        Args:
            command: The command of this period.
            lag_m: Lag of the joint targets behind it [m].
            limits: What is allowed.
            near: Parts of the robot that stopped it before they met, if some did.
        """
        self._sent = [*self._sent[1:], self._environment.previous_action]
        if lag_m > limits.lag_m:
            held = near or "limits of the arm's joints or speeds"
            return f"{held} held the hand back in `{command.segment}`"
        touched = self._touch.unintended(command.contact, limits.press_n, fingers=limits.fingers)
        if touched:
            return f"touched `{touched}` in `{command.segment}`"
        deep = self._pressed(command.contact, limits)
        if deep:
            return f"`{deep[0]}` was pressed too deep into `{deep[1]}` in `{command.segment}`"
        return self._moved(command.segment, limits)

    def _pressed(self, contact: bool, limits: Filters) -> tuple[str, str] | None:
        """Two bodies that are pressed together too much; an impact of what was let go is none."""
        deep = self._touch.deeper(contact, limits.depth_m, limits.grip_m)
        steps, period = self._environment.steps, self._environment.period_s
        self._falling = {each[:2]: self._falling.get(each[:2], steps) for each in deep if each.free}
        for each in deep:
            if not each.free or (steps - self._falling[each[:2]]) * period >= IMPACT_S - 1e-9:
                return each[:2]
        return None

    def _moved(self, segment: str, limits: Filters) -> str:
        """The joint that moved faster, or was accelerated more, than the robot can."""
        speed = np.abs(self._environment.data.qvel[self._dofs])
        fast = np.flatnonzero(speed > self._limits * limits.speed)
        if len(fast):
            return f"joint `{self._names[fast[0]]}` moved faster than its limit in `{segment}`"
        before, last, now = self._sent
        bend = np.abs(now - 2 * last + before) / self._environment.period_s**2
        bent = np.flatnonzero(self._arm & (bend > self._accelerations * limits.acceleration))
        return f"joint `{self._names[bent[0]]}` was accelerated above its limit in `{segment}`" if len(bent) else ""
