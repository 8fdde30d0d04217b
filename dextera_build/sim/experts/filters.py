"""Filters: limits whose violation discards an episode.

Contact forces and penetration are checked in every substep of the simulation, because an impact lasts a few of them;
everything else at the end of every control period.
"""

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
    """Maximum force between two bodies that should not touch [N]: the robot and anything but what its hand should
    touch, or the task's object and what neither carries it nor is named by the goal."""
    displaced_m: float = 0.005
    """Maximum displacement of a bystander, a movable body that has no part in the task [m]."""
    fingers: bool = False
    """Whether parts of hands may touch each other at any time, as a person's do, and not in contact with the task's
    object alone."""
    depth_m: float = np.inf
    """Maximum penetration of the robot, or of an object, into anything [m]; except of an object that the robot does not
    touch, for `IMPACT_S`."""
    grip_m: float = np.inf
    """Maximum penetration where a hand should touch the object [m], but for an impact that is over within a control
    period."""
    speed: float = np.inf
    """Maximum measured speed of a joint, as a multiple of its own limit."""
    acceleration: float = np.inf
    """Maximum acceleration of the targets of an arm's joint, sent and labelled, as a multiple of its own limit."""
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
        self._speeds = np.array([joint.velocity for joint in joints])
        self._accelerations = np.array([joint.acceleration for joint in joints])
        self._arm = np.array([joint.group == "arm" for joint in joints])
        self._dofs = np.array([environment.model.joint(ROBOT + name).dofadr[0] for name in self._names])
        self._limits = Filters()
        self._start()

    def begin(self) -> None:
        """A new episode; the robot rests at the targets of its start."""
        self._touch.begin()
        self._start()

    def _start(self) -> None:
        rest = self._environment.previous_action
        self._sent, self._labels = [rest] * 3, [rest] * 3
        # Limb -> whether its hand should touch something; a limb without a target goes on with what it did.
        self._touches: dict[str, bool] = {}
        # Pairs of bodies without the robot that are too deep -> first and last time [s].
        self._falling: dict[tuple[str, str], tuple[float, float]] = {}
        self._found = ""

    def expect(self, command: Command, limits: Filters) -> None:
        """A control period with a command begins, in which `look` is called after every substep.

        Args:
            command: The command of this period; what the last one intended may still be touched.
            limits: What is allowed.
        """
        before = [limb for limb, touches in self._touches.items() if touches]
        self._touches |= {limb: command.part(limb).contact for limb in command.aims}
        self._limits, self._found = limits, ""
        self._touch.intend([*before, *self._intended()], fingers=limits.fingers)

    def look(self) -> None:
        """Note the first violation by contacts at this moment."""
        self._found = self._found or self._touch.unintended(self._limits.press_n) or self._deep()

    def fault(self, command: Command, lag_m: float, label: np.ndarray, near: str = "") -> str:
        """The first violation in the control period that has just ended; empty if there is none.

        Args:
            command: The command of this period.
            lag_m: Lag of the joint targets behind it [m].
            label: Joint targets (A,) of the command without noise and perturbation [rad].
            near: Parts of the robot that stopped it before they met, if some did.
        """
        self._sent = [*self._sent[1:], self._environment.previous_action]
        self._labels = [*self._labels[1:], label]
        self._touch.intend(self._intended(), fingers=self._limits.fingers)
        self.look()
        reason = self._lagging(lag_m, near) or self._found or self._knocked() or self._moved()
        return f"{reason} in `{command.segment}`" if reason else ""

    def _intended(self) -> list[str]:
        return [limb for limb, touches in self._touches.items() if touches]

    def _lagging(self, lag_m: float, near: str) -> str:
        held = near or "limits of the arm's joints or speeds"
        return f"{held} held the hand back" if lag_m > self._limits.lag_m else ""

    def _deep(self) -> str:
        """Two bodies pressed together too much; an impact of what was let go or of a closing hand is none."""
        deep = self._touch.deeper(self._limits.depth_m, self._limits.grip_m)
        if not deep:
            return ""
        now, period = float(self._environment.data.time), self._environment.period_s
        for each in deep:
            pair = each[:2]
            first, last = self._falling.get(pair, (now, now))
            # What bounces does not begin anew.
            first = first if now - last <= period + 1e-9 else now
            within = IMPACT_S if each.free else period if each.meant else 0.0
            if now - first >= within - 1e-9:
                return f"`{each.one}` was pressed too deep into `{each.other}`"
            self._falling[pair] = first, now
        return ""

    def _knocked(self) -> str:
        knocked = self._touch.displaced(self._limits.displaced_m)
        return f"`{knocked}` was knocked or moved" if knocked else ""

    def _moved(self) -> str:
        """The joint that moved faster, or was accelerated more, than the robot can."""
        limits, period = self._limits, self._environment.period_s
        speed = np.abs(self._environment.data.qvel[self._dofs])
        if found := self._joint(speed > self._speeds * limits.speed):
            return f"joint `{found}` moved faster than its limit"
        for said, (before, last, now) in (("", self._sent), ("the label of ", self._labels)):
            bend = np.abs(now - 2 * last + before) / period**2
            if found := self._joint(self._arm & (bend > self._accelerations * limits.acceleration)):
                return f"{said}joint `{found}` was accelerated above its limit"
        step = np.abs(self._labels[-1] - self._labels[-2]) / period
        found = self._joint(step > self._speeds * limits.speed + 1e-9)
        return f"the label of joint `{found}` was faster than its limit" if found else ""

    def _joint(self, where: np.ndarray) -> str:
        """The first joint where (A,) is True; empty if there is none."""
        return self._names[int(where.argmax())] if where.any() else ""
