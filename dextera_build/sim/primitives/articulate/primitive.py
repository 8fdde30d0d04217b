"""Primitive `articulate`: an object's joints are at their commanded positions, and the object has not moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import Field, PositiveFloat, model_validator

from dextera_build.errors import did_you_mean, listing
from dextera_build.sim.primitives import base
from dextera_build.sim.primitives.base import Past, Setting, TypedGoal, UnfitError
from dextera_build.sim.primitives.stages import DONE, MOVE, REACH, clamp, near
from dextera_build.sim.primitives.state import TaskState

LIMIT_RAD = 0.05
"""Distance beyond its limit at which a joint counts as forced [rad or m]."""
REST = 0.25
"""Maximum speed of a joint at rest [rad/s or m/s]."""
STRAY_M = 0.15
"""Maximum displacement of the base; beyond it the object was thrown or dragged, not operated [m]."""
TILT_RAD = 0.5
"""Maximum tilt of the base [rad]."""
DRAG = 0.4
"""Cost of dragging an object by the allowed distance; small, because slippery objects move slightly."""


class ArticulateGoal(TypedGoal):
    """Joints of the object are at commanded positions."""

    primitive: str = "articulate"
    names: tuple[str, ...] = ()
    joints: dict[str, float]
    """Joint in the model -> commanded position [rad or m]."""
    tolerance: float
    """Maximum deviation of every joint from its command [rad or m]."""

    @model_validator(mode="before")
    @classmethod
    def _named(cls, fields: Any) -> Any:
        # Sorted, as the items of a stored mapping are.
        return {"names": tuple(sorted(fields["joints"])), **fields}

    def numbers(self, base_from_world: np.ndarray) -> tuple[float, ...]:
        """The commanded positions [rad or m]."""
        return tuple(self.joints[name] for name in self.names)


class Options(base.Options):
    """Options of an articulation."""

    joints_deg: dict[str, float] = Field(default_factory=dict)
    """Joint of the asset -> commanded position [deg]."""
    tolerance_deg: PositiveFloat = 5.0
    """Maximum distance from the command [deg]."""

    @model_validator(mode="after")
    def _named(self) -> Options:
        if not self.joints_deg:
            raise ValueError("`joints_deg` names no joint to move; set `joints_deg: {hinge: 0}`")
        return self

    def fitted(self, joints: Sequence[str]) -> Options:
        """All joints of the object, if it lacks one of those that are named."""
        if self.joints_deg.keys() <= set(joints):
            return self
        return self.model_copy(update={"joints_deg": dict.fromkeys(joints, 0.0)})

    def goal(self, setting: Setting) -> ArticulateGoal:
        """The commands in the names of the model [rad]; joints must be the object's, and commands within limits."""
        known, tolerance = setting.joints, float(np.radians(self.tolerance_deg))
        joints = listing(known, most=20) or "none"
        goals = {}
        for label, degrees in self.joints_deg.items():
            if label not in known:
                raise UnfitError(
                    f"`{setting.object}` has no joint `{label}`",
                    joints=joints,
                    hint=did_you_mean(label, known)
                    or (f"set `joints_deg: {{{next(iter(known))}: 0}}`" if known else "choose an object with a joint"),
                )
            name, lower, upper = known[label]
            goals[name] = float(np.radians(degrees))
            if not lower - tolerance <= goals[name] <= upper + tolerance:
                raise UnfitError(
                    f"joint `{label}` cannot reach {degrees:.1f}°",
                    limits=f"{np.degrees(lower):.1f}° to {np.degrees(upper):.1f}°",
                    hint="set `joints_deg` inside the limits",
                )
        return ArticulateGoal(joints=goals, tolerance=tolerance)


class Primitive(base.Primitive[ArticulateGoal]):
    """Every selected joint is within tolerance of its command, at rest and not forced past a limit."""

    goal_type = ArticulateGoal
    against = ("nothing",)
    still = "on support"
    feels = False
    carries = False

    def holds(self, start: TaskState, now: TaskState, past: Past) -> bool:
        """Whether the joints are at their commands, and the object has not moved."""
        return self._stands(start, now) and all(self._arrived(now, name) for name in self.goal.joints)

    def missing(self, start: TaskState, now: TaskState, past: Past) -> str:
        """The reason: the object moved, or a joint is not at its command."""
        return "a joint is not at its command" if self._stands(start, now) else "the object was moved"

    def value(self, reach_m: float, start: TaskState, now: TaskState, *, success: bool) -> float:
        """See `value`."""
        return value(self.progress(reach_m, start, now, success=success))

    def progress(self, reach_m: float, start: TaskState, now: TaskState, *, success: bool) -> Progress:
        """Progress, measured at the joint farthest from its command."""
        left = max((self._left(start, now, name) for name in self.goal.joints), default=0.0)
        moved = now.world_from_object[:3, 3] - start.world_from_object[:3, 3]
        return Progress(reach_m, left, float(np.linalg.norm(moved)) / STRAY_M, success)

    def drawn(self, across_m: np.ndarray, turn_rad: float) -> ArticulateGoal:
        """Other commands."""
        joints = {name: place + turn_rad for name, place in self.goal.joints.items()}
        return self.goal.model_copy(update={"joints": joints})

    def pushed(self, start: TaskState, now: TaskState) -> tuple[str, float] | None:
        """The joint farthest from its command, the last of equals."""
        name = max(reversed(self.goal.joints), key=lambda each: self._left(start, now, each))
        return name, self.goal.joints[name] - now.joints[name]

    def _left(self, start: TaskState, now: TaskState, name: str) -> float:
        goal = self.goal.joints[name]
        return abs(now.joints[name] - goal) / max(abs(start.joints[name] - goal), self.goal.tolerance, 1e-6)

    @staticmethod
    def _stands(start: TaskState, now: TaskState) -> bool:
        moved = now.world_from_object[:3, 3] - start.world_from_object[:3, 3]
        upright = float(now.world_from_object[:3, 2] @ start.world_from_object[:3, 2])
        # Comparisons are written to fail on NaN.
        return bool(float(np.linalg.norm(moved)) <= STRAY_M and upright >= np.cos(TILT_RAD))

    def _arrived(self, now: TaskState, name: str) -> bool:
        position, (lower, upper) = now.joints[name], now.ranges[name]
        near = abs(position - self.goal.joints[name]) <= self.goal.tolerance and abs(now.speeds[name]) <= REST
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

    The weight of reaching decreases as the joints approach their commands, so that the hand may release a joint at its
    command. Dragging the object reduces the value.
    """
    moved = 1.0 - clamp(progress.left, 0.0, 2.0)
    reach = 1.0 - (1.0 - near(progress.reach_m)) * min(1.0, progress.left)
    return REACH * reach - DRAG * min(2.0, progress.strayed) + MOVE * moved + DONE * float(progress.success)
