"""Kinds of actions: the meaning of an action's numbers, declared once for all robots.

A world moves its robot by joint targets. An action of another kind is an equivalent representation relative to the last
targets, so that it produces the same motion in every world. Spaces of Gymnasium, the feature `action` of LeRobot and
the table in the docs are generated from here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.task import ActionKind, TaskSpec
from dextera_build.errors import RuleError, listing

PALM_M_S, PALM_RAD_S = 1.0, 3.0
"""Maximum speeds of a palm that an action of kind `end_effector` can command [m/s, rad/s]."""
PALM = ("dx", "dy", "dz", "rx", "ry", "rz")
"""Change of a palm's pose along and about the axes of the base: translation [m], rotation vector [rad]."""

ABOUT: Mapping[ActionKind, tuple[str, str]] = {
    "joint": ("targets of the robot's joints", "rad or m"),
    "delta": ("change of the joint targets sent last", "rad or m per step"),
    "end_effector": (
        "change of the palms' poses since the joint targets sent last, in the base; targets of the hands' joints",
        "m and rad per step; rad or m",
    ),
}
"""Kind -> meaning and units of its numbers."""


@dataclass(frozen=True)
class ActionSpec:
    """The actions of one kind for one robot at one rate."""

    kind: ActionKind
    """Kind of the actions."""
    names: tuple[str, ...]
    """Names of the numbers, in order."""
    lower: np.ndarray
    """Lower limits of the numbers (N,)."""
    upper: np.ndarray
    """Upper limits of the numbers (N,)."""
    rate_hz: float
    """Actions per second [Hz]."""


def of_task(task: TaskSpec, robot: RobotModel, kind: ActionKind | None = None) -> ActionSpec:
    """The actions of a task.

    Args:
        task: The task, with the rate and the default kind.
        robot: The embodiment.
        kind: Another kind; None: the task's.

    Raises:
        RuleError: There is no such kind, or the robot has no palm.
    """
    kind = task.action if kind is None else kind
    if kind not in ABOUT:
        raise RuleError(
            f"there is no kind of action `{kind}`",
            code="DXB-B515",
            facts={"kinds": listing(ABOUT)},
            hint='`action="delta"`',
        )
    lower, upper, speed = (np.array([getattr(joint, name) for joint in robot.joints]) for name in _LIMITS)
    names = tuple(joint.name for joint in robot.joints)
    if kind == "joint":
        return ActionSpec(kind, names, lower, upper, task.control_hz)
    if kind == "delta":
        step = speed / task.control_hz
        return ActionSpec(kind, tuple(f"{name}.delta" for name in names), -step, step, task.control_hz)
    palms = palms_of(robot)
    alone = len(palms) == 1
    step = np.tile(np.repeat([PALM_M_S, PALM_RAD_S], 3) / task.control_hz, len(palms))
    fingers = fingers_of(robot)
    moved = tuple(part if alone else f"{limb}.{part}" for limb in palms for part in PALM)
    found = (*moved, *(names[number] for number in fingers))
    return ActionSpec(
        kind, found, np.concatenate([-step, lower[fingers]]), np.concatenate([step, upper[fingers]]), task.control_hz
    )


def palms_of(robot: RobotModel) -> tuple[str, ...]:
    """The limbs that have an arm and a palm.

    Raises:
        RuleError: There is none.
    """
    found = tuple(name for name in robot.limb_names if robot.limbs[name].palm and robot.limbs[name].arm)
    if not found:
        raise RuleError(
            "actions of kind `end_effector` move palms, but no limb of the robot has one",
            code="DXB-B515",
            facts={"limbs": listing(robot.limb_names), "frames": listing(robot.frames, most=40)},
            hint="add a frame `palm` to the robot, or choose `joint` or `delta`",
        )
    return found


def fingers_of(robot: RobotModel) -> np.ndarray:
    """Indices of the hands' joints of limbs with a palm among the robot's joints (H,)."""
    hands = {joint for limb in palms_of(robot) for joint in robot.limbs[limb].hand}
    return np.array([number for number, joint in enumerate(robot.joints) if joint.name in hands], int)


_LIMITS = ("lower", "upper", "velocity")
