"""Primitive `articulate`: an object's joints are at their commanded positions, and the object has not moved."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import Field, PositiveFloat, model_validator

from dextera_build.errors import did_you_mean, listing
from dextera_build.sim.primitives import base
from dextera_build.sim.primitives.base import Past, Setting, TypedGoal, UnfitError, lengths
from dextera_build.sim.primitives.stages import DONE, MOVE, REACH, clamp, near
from dextera_build.sim.primitives.state import TaskState

LIMIT_RAD = 0.05
"""Distance beyond its limit at which a joint counts as forced [rad or m]."""
REST = 0.25
"""Maximum speed of a joint at rest [rad/s or m/s]."""
STRAY_M = 0.15
"""Maximum displacement of the base; beyond it the object was thrown or dragged, not operated [m]."""
UPRIGHT = float(np.cos(0.5))
"""Cosine of the maximum tilt of the base."""
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
    shaped = False
    against = ("nothing",)
    still = "on support"
    feels = False
    carries = False
    stages = ("moved", "halfway", "at its command")

    def holds(self, start: TaskState, now: TaskState, past: Past) -> np.ndarray:
        """Whether the joints are at their commands, and the object has not moved."""
        found = self._stands(start, now)
        for name in self.goal.joints:
            found = found & self._arrived(start, now, name)
        return found

    def missing(self, start: TaskState, now: TaskState, past: Past) -> np.ndarray:
        """The reason: the object moved, or a joint is not at its command."""
        return np.where(self._stands(start, now), "a joint is not at its command", "the object was moved")

    def reached(self, start: TaskState, now: TaskState, past: Past) -> np.ndarray:
        """A tenth of the way, half of it, and the command, by the joint farthest from its own; the object stands."""
        stands, left = self._stands(start, now), self._farthest(start, now)
        return base.furthest(stands & (left <= 0.9), stands & (left <= 0.5), self.holds(start, now, past))

    def value(self, reach_m: np.ndarray, start: TaskState, now: TaskState, success: np.ndarray) -> np.ndarray:
        """See `value`."""
        return value(self.progress(reach_m, start, now, success))

    def progress(self, reach_m: np.ndarray, start: TaskState, now: TaskState, success: np.ndarray) -> Progress:
        """Progress, measured at the joint farthest from its command."""
        strayed = self._moved(start, now) / STRAY_M
        return Progress(reach_m, self._farthest(start, now), strayed, success)

    def drawn(self, across_m: np.ndarray, turn_rad: float) -> ArticulateGoal:
        """Other commands."""
        joints = {name: place + turn_rad for name, place in self.goal.joints.items()}
        return self.goal.model_copy(update={"joints": joints})

    def pushed(self, start: TaskState, now: TaskState) -> tuple[np.ndarray, np.ndarray]:
        """The joint farthest from its command, the last of equals."""
        (first, left), *rest = self._left(start, now).items()
        names, most = np.full(len(left), first), left
        way = self.goal.joints[first] - now.joints[first]
        for name, left in rest:
            farther = left >= most
            names, most = np.where(farther, name, names), np.maximum(left, most)
            way = np.where(farther, self.goal.joints[name] - now.joints[name], way)
        return names, way

    def _farthest(self, start: TaskState, now: TaskState) -> np.ndarray:
        """The largest of `_left` (N,)."""
        return functools.reduce(np.maximum, self._left(start, now).values())

    def _left(self, start: TaskState, now: TaskState) -> dict[str, np.ndarray]:
        """Distances of joints from their commands (N,), as fractions of those at the start."""
        least = max(self.goal.tolerance, 1e-6)
        before, after = (state.once("away", self.goal, self._away) for state in (start, now))
        return {name: after[name] / np.maximum(before[name], least) for name in self.goal.joints}

    def _away(self, state: TaskState) -> dict[str, np.ndarray]:
        """Distances of joints from their commands (N,) [rad or m]."""
        return {name: np.abs(state.joints[name] - goal) for name, goal in self.goal.joints.items()}

    @staticmethod
    def _moved(start: TaskState, now: TaskState) -> np.ndarray:
        """Displacement of the object (N,) [m]."""
        return now.once("moved", start, lambda state: lengths(state.place - start.place))

    def _stands(self, start: TaskState, now: TaskState) -> np.ndarray:
        upright = np.vecdot(now.world_from_object[:, :3, 2], start.world_from_object[:, :3, 2])
        # Comparisons are written to fail on NaN.
        return np.asarray((self._moved(start, now) <= STRAY_M) & (upright >= UPRIGHT))

    def _arrived(self, start: TaskState, now: TaskState, name: str) -> np.ndarray:
        at_goal = now.once("away", self.goal, self._away)[name] <= self.goal.tolerance
        low, high = start.once("limits", self.goal, self._limits)[name]
        free = (low <= now.joints[name]) & (now.joints[name] <= high)
        return np.asarray(at_goal & (np.abs(now.speeds[name]) <= REST) & free)

    def _limits(self, state: TaskState) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Positions of joints (N,) beyond which they are forced [rad or m]."""
        limits = {name: state.ranges[name] for name in self.goal.joints}
        return {name: (each[:, 0] - LIMIT_RAD, each[:, 1] + LIMIT_RAD) for name, each in limits.items()}


@dataclass(eq=False)
class Progress:
    """Progress of moving joints in N worlds."""

    reach_m: np.ndarray
    """Distance of the nearest fingertip from the push position (N,) [m]."""
    left: np.ndarray
    """Distance of the joints from their commands (N,), as a fraction of the initial distance."""
    strayed: np.ndarray
    """Distance dragged (N,), as a fraction of the allowance."""
    success: np.ndarray
    """Whether the task is done (N,)."""


def value(progress: Progress) -> np.ndarray:
    """Values of states (N,): reach, then bring the joints to their commands, then success.

    The weight of reaching decreases as the joints approach their commands, so that the hand may release a joint at its
    command. Dragging the object reduces the value.
    """
    moved = 1.0 - clamp(progress.left, 0.0, 2.0)
    reach = 1.0 - (1.0 - near(progress.reach_m)) * np.fmin(1.0, progress.left)
    dragged = np.fmin(2.0, progress.strayed)
    return np.asarray(REACH * reach - DRAG * dragged + MOVE * moved + DONE * progress.success)
