"""Where commands lead the joints of a robot over time, as the JointTrajectory controller of ros2_control follows them.

Points are joined by straight lines; velocities and accelerations of points are not read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.formats.ros.reading import SECOND


@dataclass(frozen=True)
class Command:
    """A command of a controller."""

    joints: tuple[str, ...]
    """Joints of the model (J)."""
    stamp: int
    """When it begins, by the robot's clock [ns]; 0: when it arrives."""
    reach_s: tuple[float, ...]
    """When each point is reached, after the beginning (P) [s]; no point: the joints hold."""
    targets: tuple[tuple[float, ...], ...]
    """Targets of the joints at each point (P, J) [rad or m]."""

    def due_s(self, now: int) -> tuple[float, ...]:
        """When each point is reached (P), after a time by the robot's clock [s]; below 0: it is over."""
        return tuple((self.stamp - now) / SECOND + each if self.stamp else each for each in self.reach_s)


class Plans:
    """The present plan of every joint.

    Args:
        joints: Joints of the model (A).
        places: Where they are held at first (A) [rad or m]; NaN: not known.
    """

    def __init__(self, joints: Sequence[str], places: np.ndarray) -> None:
        self._rows = {joint: row for row, joint in enumerate(joints)}
        self._plans = [(0, np.zeros(1), np.array([place])) for place in places]

    def follow(self, command: Command, now: int, places: np.ndarray) -> None:
        """Follow a command that arrives `now` [ns], by the robot's clock; joints without a plan are at `places` (A)."""
        due, before = command.due_s(now), self.at(now)
        start = np.where(np.isfinite(before), before, places)
        fresh = list(self._plans)
        for column, joint in enumerate(command.joints):
            row = self._rows[joint]
            times, values = [*due], [point[column] for point in command.targets]
            if not times or (times[0] > 0.0 and np.isfinite(start[row])):
                times, values = [0.0, *times], [float(start[row]), *values]
            fresh[row] = (now, np.array(times), np.array(values))
        self._plans = fresh  # whole, because another thread reads it

    @property
    def ends(self) -> np.ndarray:
        """Targets (A) at the ends of the plans [rad or m]; NaN for a joint that was not commanded."""
        return np.array([values[-1] for _, _, values in self._plans])

    def at(self, time: int) -> np.ndarray:
        """Targets (A) at a time [ns] by the robot's clock [rad or m]; NaN for a joint that was not commanded."""
        return np.array(
            [np.interp((time - begun) / SECOND, times, values) for begun, times, values in self._plans], np.float64
        )
