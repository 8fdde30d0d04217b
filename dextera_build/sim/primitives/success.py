"""Success of the task primitives: pure functions of quantities that can be measured in any world.

Nothing here knows a simulator. A condition is judged once per control period; success means that it held without a
break for `hold_s`, that it did not hold at the reset, and that the clock starts anew after any break.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from dextera_build.artifacts.task import TaskSpec


@dataclass(frozen=True)
class GraspState:
    """The hold on the task's object in one control period."""

    fingers: int = 0
    """Fingers, the palm counted as one, that press on the object."""
    opposing: bool = False
    """Whether two of the forces on the object point against one another."""
    supported: bool = True
    """Whether anything but the hand touches the object."""
    slip_m_s: float = 0.0
    """Speed of the object relative to the palm [m/s]."""


@dataclass(frozen=True)
class TaskState:
    """What success is judged by."""

    time_s: float
    """Since the start of the episode [s]."""
    world_from_object: np.ndarray
    """T_world_object of the task's object (4, 4)."""
    joints: Mapping[str, float] = field(default_factory=dict)
    """Joint of the task's object -> position [rad or m]."""
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Joint -> limits [rad or m]."""
    speeds: Mapping[str, float] = field(default_factory=dict)
    """Joint -> velocity [rad/s or m/s]."""
    grasp: GraspState = GraspState()
    """The hold on the object."""


SLIP_M_S = 0.05
"""A held object moves slower than this relative to the palm [m/s]; the same in every world."""
LIMIT_RAD = 0.05
"""A joint farther beyond its limit than this was forced [rad or m]."""
REST = 0.25
"""A joint that moves faster than this has not arrived but passes through [rad/s or m/s]."""
STRAY_M = 0.15
"""An articulated object whose base was carried farther than this was thrown or dragged, not operated [m]."""
TILT_RAD = 0.5
"""... or tipped by more than this [rad]."""


def holds(task: TaskSpec, start: TaskState, now: TaskState) -> bool:
    """Whether the task's condition holds now, given the state at the start of the episode."""
    return _CONDITIONS[task.primitive](task, start, now)


def lifted(task: TaskSpec, start: TaskState, now: TaskState) -> bool:
    """Lift: the object's origin rose by `height_m` and a valid grasp, and nothing else, holds it.

    A valid grasp is two or more fingers that press against one another, no other support, and no slip. A
    throw fails for want of fingers, pinning against the table for want of height and for the support.
    """
    rise = float(now.world_from_object[2, 3] - start.world_from_object[2, 3])
    grasp = now.grasp
    held = grasp.fingers >= 2 and grasp.opposing and not grasp.supported and grasp.slip_m_s < SLIP_M_S
    return rise >= task.height_m and held


def articulated(task: TaskSpec, start: TaskState, now: TaskState) -> bool:
    """Articulation: every selected joint is within tolerance of its command, at rest and not forced past a limit."""
    moved = now.world_from_object[:3, 3] - start.world_from_object[:3, 3]
    upright = float(now.world_from_object[:3, 2] @ start.world_from_object[:3, 2])
    # Comparisons are put so that NaN fails them.
    stands = float(np.linalg.norm(moved)) <= STRAY_M and upright >= np.cos(TILT_RAD)
    return bool(stands) and all(_arrived(task, now, name) for name in task.joints)


def _arrived(task: TaskSpec, now: TaskState, name: str) -> bool:
    position, (lower, upper) = now.joints[name], now.ranges[name]
    near = abs(position - task.joints[name]) <= task.tolerance and abs(now.speeds[name]) <= REST
    return near and lower - LIMIT_RAD <= position <= upper + LIMIT_RAD


_CONDITIONS = {"lift": lifted, "articulate": articulated}


class Judge:
    """Follows one episode and says when it has succeeded.

    Args:
        task: The objective.
        start: State at the reset.
    """

    def __init__(self, task: TaskSpec, start: TaskState) -> None:
        self.task = task
        self.start = start
        self.held_at_reset = holds(task, start, start)
        self._since: float | None = None

    def update(self, now: TaskState) -> bool:
        """Take in one control period; True once the condition has held for `hold_s`."""
        if self.held_at_reset or not holds(self.task, self.start, now):
            self._since = None
            return False
        if self._since is None:
            self._since = now.time_s
        return now.time_s - self._since >= self.task.hold_s - 1e-9
