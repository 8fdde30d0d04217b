"""The interface of a robot cell: the simulator, a simulated cell with a tracker, or a hardware driver.

A `RobotCell` measures and sends; its `Guard` enforces the same limits for all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from dextera_build.artifacts.robots.cell import Limits
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.errors import listing
from dextera_build.policy.observation import Frames, Measurement
from dextera_build.policy.running import PolicyFault


class RobotCell(Protocol):
    """Interface for policies, operators and replays; in every control period it first measures, then sends."""

    def measure(self, frames: Frames | None = None) -> Measurement:
        """The measurements of this control period, with the given frames of other cameras."""

    def send(self, targets: np.ndarray) -> np.ndarray:
        """Send joint targets (A,) [rad] for one control period; returns the targets sent, within limits.

        Raises:
            Stopped: A limit of the cell is exceeded, and nothing was sent.
        """


class Stopped(PolicyFault):
    """The guard has stopped the robot, which holds the last targets."""


class Guard:
    """Enforces a cell's limits on targets.

    Targets are clamped to the range of each joint and to its speed; any other violation stops the robot, until `begin`.

    Args:
        limits: Limits of the cell.
        robot: The embodiment.
        rate_hz: Control rate [Hz].
        palms: Joint positions (A,) to positions (L, 3) of the palms in the base frame [m], by `RobotModel.limb_names`.
        ramp_s: Time after `begin` in which the speed limits rise from 0 [s], because the first targets may be far away.
    """

    def __init__(
        self,
        limits: Limits,
        robot: RobotModel,
        rate_hz: float,
        palms: Callable[[np.ndarray], np.ndarray],
        ramp_s: float = 0.0,
    ) -> None:
        self._limits, self._palms, self._limbs = limits, palms, robot.limb_names
        self._names = [joint.name for joint in robot.joints]
        self._lower, self._upper, speed = (
            np.array([getattr(joint, name) for joint in robot.joints]) for name in ("lower", "upper", "velocity")
        )
        self._step = limits.speed * speed / rate_hz
        self._ramp, self._passed = max(1.0, ramp_s * rate_hz), 0
        self._tips = robot.tips
        self._last = np.zeros(len(self._names))
        self._why = ""

    def begin(self, targets: np.ndarray) -> None:
        """Begin with the current targets (A,) [rad]."""
        self._last, self._why, self._passed = np.array(targets, np.float64), "", 0

    def stop(self, why: str) -> Stopped:
        """Stop the robot until `begin` for a reason outside of the targets; returns what to raise."""
        self._why = self._why or why
        return Stopped(f"the guard stopped the robot: {self._why}", code="DXB-B249")

    def passed(self, targets: np.ndarray, forces: np.ndarray, silent_s: float) -> np.ndarray:
        """The targets (A,) that may be sent.

        Args:
            targets: Requested targets (A,) [rad].
            forces: Forces on the fingertips (F, 3) [N].
            silent_s: Time since the last frame arrived [s].

        Raises:
            Stopped: A limit is exceeded, now or since `begin`.
        """
        found = np.asarray(targets, np.float64)
        self._why = self._why or self._finite(found) or self._watched(forces, silent_s)
        if not self._why:
            step = self._step * min(1.0, (self._passed + 1) / self._ramp)
            near = np.clip(found, self._last - step, self._last + step)
            # From beyond a limit, a joint returns at its speed, and goes no farther.
            found = np.clip(near, np.minimum(self._lower, self._last), np.maximum(self._upper, self._last))
            self._why = self.outside(found)
        if self._why:
            raise self.stop(self._why)
        self._last, self._passed = found, self._passed + 1
        return found

    def _finite(self, targets: np.ndarray) -> str:
        if targets.shape != self._last.shape:
            return f"{targets.size} targets for {len(self._names)} joints"
        bad = [name for name, target in zip(self._names, targets, strict=True) if not np.isfinite(target)]
        return f"the target of {listing(bad)} is not a finite number" if bad else ""

    def _watched(self, forces: np.ndarray, silent_s: float) -> str:
        if silent_s > self._limits.silence_s:
            return f"no frame arrived for more than {self._limits.silence_s:g} s"
        most = self._limits.force_n
        if most is None or not len(forces):
            return ""
        strongest = int(np.linalg.norm(forces, axis=1).argmax())
        within = float(np.linalg.norm(forces[strongest])) <= most
        return "" if within else f"`{self._tips[strongest]}` presses with more than {most:g} N"

    def outside(self, targets: np.ndarray) -> str:
        """Which palm leaves the workspace at targets (A,) [rad]; empty if none does."""
        if self._limits.workspace_m is None:
            return ""
        low, high = np.array(self._limits.workspace_m)
        for limb, place in zip(self._limbs, self._palms(targets), strict=True):
            for axis, at, least, most in zip("xyz", place, low, high, strict=True):
                if not least <= at <= most:
                    return (
                        f"the palm of `{limb}` would leave the workspace: {axis} is not within {least:g} to {most:g} m"
                    )
        return ""
