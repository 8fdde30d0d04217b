"""Primitive `articulate`: an object's joints are at their commanded positions, and the object has not moved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.task import TaskSpec
from dextera_build.sim.primitives.stages import DONE, MOVE, REACH, near
from dextera_build.sim.primitives.state import TaskState

LIMIT_RAD = 0.05
"""Distance beyond its limit from which a joint counts as forced [rad or m]."""
REST = 0.25
"""Maximum speed of a joint at rest; a faster one is passing through [rad/s or m/s]."""
STRAY_M = 0.15
"""Maximum displacement of the base; beyond it the object was thrown or dragged, not operated [m]."""
TILT_RAD = 0.5
"""Maximum tilt of the base [rad]."""
DRAG = 0.4
"""Cost of dragging an object by the allowed distance; small, because slippery objects move slightly."""


def succeeded(task: TaskSpec, start: TaskState, now: TaskState) -> bool:
    """Whether every selected joint is within tolerance of its command, at rest and not forced past a limit."""
    moved = now.world_from_object[:3, 3] - start.world_from_object[:3, 3]
    upright = float(now.world_from_object[:3, 2] @ start.world_from_object[:3, 2])
    # Comparisons are written to fail on NaN.
    stands = float(np.linalg.norm(moved)) <= STRAY_M and upright >= np.cos(TILT_RAD)
    return bool(stands) and all(_arrived(task, now, name) for name in task.joints)


def _arrived(task: TaskSpec, now: TaskState, name: str) -> bool:
    position, (lower, upper) = now.joints[name], now.ranges[name]
    near = abs(position - task.joints[name]) <= task.tolerance and abs(now.speeds[name]) <= REST
    return near and lower - LIMIT_RAD <= position <= upper + LIMIT_RAD


@dataclass(frozen=True)
class Progress:
    """Progress of moving joints."""

    reach_m: float
    """Distance of the nearest fingertip from the push position [m]."""
    left: float
    """Distance of the joints from their commands, as a fraction of the initial distance."""
    strayed: float
    """Distance dragged, as a fraction of the allowance."""
    success: bool
    """Whether the task is done."""


def value(progress: Progress) -> float:
    """Value of a state: reach, then bring the joints to their commands, then success.

    The weight of reaching falls as the joints approach their commands, so the hand may release a joint that has
    arrived. Dragging the object reduces the value.
    """
    moved = 1.0 - float(np.clip(progress.left, 0.0, 2.0))
    reach = 1.0 - (1.0 - near(progress.reach_m)) * min(1.0, progress.left)
    return REACH * reach - DRAG * min(2.0, progress.strayed) + MOVE * moved + DONE * float(progress.success)
