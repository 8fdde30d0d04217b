"""Interface of a primitive: its options, goal, conditions of success and failure, and the value of a state.

A primitive is a folder with a file `primitive.py`, which defines the classes `Options` and `Primitive`, derived from
those here; see docs/primitives.md. Its conditions use only quantities that can be measured in any world, so that
simulator, tracker and hardware are judged by the same code.
"""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.goals import Goal
from dextera_build.artifacts.tasks.task import TaskObject, TaskSpec
from dextera_build.errors import listing
from dextera_build.geometry import lie, transforms
from dextera_build.sim.primitives.stages import clamp
from dextera_build.sim.primitives.state import TaskState, chosen

JUMP_M_S = 3.0
"""Speed above which an object was thrown, or moved by something other than the robot [m/s]."""


class TypedGoal(Goal, ABC):
    """A goal with the fields of its primitive, which gives `primitive` and, if they are always the same, `names`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @abstractmethod
    def numbers(self, base_from_world: np.ndarray) -> tuple[float, ...]:
        """The goal in the observations of policies, one number for each of `names`.

        Args:
            base_from_world: T_base_world (4, 4).
        """


G = TypeVar("G", bound=TypedGoal)


class UnfitError(Exception):
    """The parameters of a task do not fit its scene or its robot.

    Args:
        message: The fault.
        hint: A correction.
        **facts: Values and alternatives that the error shows.
    """

    def __init__(self, message: str, hint: str | None = None, **facts: str) -> None:
        super().__init__(message)
        self.message, self.hint, self.facts = message, hint, facts


def no_limb(name: str, robot: RobotModel) -> UnfitError:
    """The error of a task with a limb that its robot lacks."""
    known = " or ".join(f"`{each}`" for each in robot.limb_names)
    several = "" if len(robot.limbs) > 1 else ", or choose a robot with more limbs, such as robot/openarm_revo1"
    return UnfitError(f"the robot has no limb `{name}`", limbs=listing(robot.limb_names), hint=f"name {known}{several}")


@dataclass(frozen=True)
class Setting:
    """Context of the parameters of a task."""

    task: str
    """Name of the task."""
    object: str
    """Body of the task's object."""
    objects: Mapping[str, TaskObject]
    """Body -> movable object."""
    joints: Mapping[str, tuple[str, float, float]]
    """Joint of the task's object in its asset -> name in the model, lower and upper limit [rad or m]."""
    robot: RobotModel
    """The embodiment."""


class Options(BaseModel):
    """Options of a primitive's goal, in recipes a group of `simulate.task` with the primitive's name."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    @property
    def containers(self) -> tuple[str, ...]:
        """Objects whose cavity the goal needs."""
        return ()

    def fitted(self, joints: Sequence[str]) -> Options:
        """These options for the shapes that stubs make: an object with these joints, and no containers."""
        return self

    def goal(self, setting: Setting) -> TypedGoal:
        """The goal with the model's names and in SI units.

        Raises:
            UnfitError: The parameters do not fit the scene or the robot.
        """
        raise NotImplementedError


@dataclass(eq=False)
class Past:
    """Summaries of N episodes so far; a function of their states."""

    before: TaskState
    """States of the previous control period."""
    stage: np.ndarray
    """Stage reached (N,), numbered by the primitive."""
    fault: np.ndarray
    """Reason why the episode can no longer succeed (N,) str; empty if it can."""
    mark: np.ndarray
    """A position (N, 3) in the world, stored by the primitive [m]; NaN: none yet."""

    @classmethod
    def begun(cls, start: TaskState) -> Past:
        """Nothing has happened since the reset."""
        count = len(start.time_s)
        return cls(start, np.zeros(count, int), np.full(count, ""), np.full((count, 3), np.nan))

    def where(self, worlds: np.ndarray, other: Past) -> Past:
        """These summaries of the worlds where `worlds` (N,) is True, and `other` of the rest."""
        return Past(
            chosen(worlds, self.before, other.before),
            np.where(worlds, self.stage, other.stage),
            np.where(worlds, self.fault, other.fault),
            np.where(worlds[:, None], self.mark, other.mark),
        )


class Primitive(ABC, Generic[G]):
    """An objective in one task.

    Args:
        task: With a goal of this primitive.
        objects: Body -> object of the task's model, with the shapes that the condition needs.
    """

    goal_type: ClassVar[type[TypedGoal]]
    """The type of its goal."""
    feels: ClassVar[bool] = True
    """Whether its condition or its value needs the grasp state."""
    shaped: ClassVar[bool] = True
    """Whether its condition or its value uses shapes of `objects`, whose sizes may differ from world to world; such
    worlds are judged one by one."""
    carries: ClassVar[bool] = True
    """Whether hands carry the object's weight, so that a heavy one is harder than a light one."""
    still: ClassVar[Literal["", "in hand", "on support"]] = ""
    """Reference against which its object should not move; empty if the object is to be moved to a target."""
    hands: ClassVar[int] = 1
    """Minimum number of hands."""
    against: ClassVar[tuple[str, ...]] = ("thumb", "palm")
    """Grips with which a trained policy begins, preferred first, see `Grip.against`."""
    stages: ClassVar[tuple[str, ...]] = ()
    """Steps on the way to success, in order, in a word or two; without any, an episode succeeds or has no progress."""

    def __init__(self, task: TaskSpec, objects: Mapping[str, TaskObject] | None = None) -> None:
        self.task = task
        goal: Any = task.goal
        if not isinstance(goal, self.goal_type):  # as it comes from the store
            goal = self.goal_type.model_validate(goal.model_dump())
        self.goal: G = goal
        self.objects = objects or {}

    @abstractmethod
    def holds(self, start: TaskState, now: TaskState, past: Past) -> np.ndarray:
        """Whether the condition holds now (N,) bool; an episode with a fault does not succeed in any case.

        Args:
            start: States at the reset.
            now: Current states.
            past: Summary of the states from `start` to `now`, inclusive.
        """

    def follow(self, past: Past, start: TaskState, now: TaskState) -> Past:
        """The summary updated with the states `now`."""
        return Past(now, past.stage, past.fault, past.mark)

    @abstractmethod
    def missing(self, start: TaskState, now: TaskState, past: Past) -> np.ndarray:
        """The condition not met at the time limit (N,) str: a few words without numbers, the same for all such ones."""

    def reached(self, start: TaskState, now: TaskState, past: Past) -> np.ndarray:
        """Number of the last of `stages` that is reached now (N,) int, from 1; 0: none. See `furthest`."""
        return np.zeros(len(now.time_s), int)

    @abstractmethod
    def value(self, reach_m: np.ndarray, start: TaskState, now: TaskState, success: np.ndarray) -> np.ndarray:
        """Values of states (N,), see `stages`.

        Args:
            reach_m: Distance of the fingertips from their target on the object (N,) [m].
            start: States at the reset.
            now: Current states.
            success: Whether the task is done (N,).
        """

    def fair(self, places: Mapping[str, np.ndarray]) -> np.ndarray:
        """Whether episodes may begin (N,) with bodies at these poses (N, 4, 4): the goal must not be reached yet."""
        return np.ones(len(places[self.task.object]), bool)

    def target(self) -> tuple[float, float, float] | None:
        """Position of the object's origin at the goal, in the world [m]; NaN: any position along this axis.

        None: its current position.
        """
        return None

    @property
    def near_m(self) -> float:
        """Distance of the object's origin from `target` at which the goal is reached already [m]."""
        return 0.0

    def drawn(self, across_m: np.ndarray, turn_rad: float) -> G | None:
        """The goal of an episode, moved and turned as drawn from `Reset`; None: the task's.

        Args:
            across_m: Displacement (2,) on the support [m].
            turn_rad: Rotation about the vertical, or change of a joint [rad].
        """
        return None

    def others(self) -> tuple[str, ...]:
        """Bodies that the goal names in addition to the task's object."""
        return ()

    def ordered(self) -> tuple[str, ...]:
        """Limbs with different roles in the goal, in the order of the roles."""
        return ()

    def reaching(self, now: TaskState) -> np.ndarray | None:
        """Limb whose hand should reach the object next (N,) str; None: the nearest, or all that the task names."""
        return None

    def pushed(self, start: TaskState, now: TaskState) -> tuple[np.ndarray, np.ndarray] | None:
        """Joint to move next (N,) str and by how much (N,) [rad or m]; None: reaching aims at the object itself."""
        return None


def faulted(fault: np.ndarray, found: Mapping[str, np.ndarray]) -> np.ndarray:
    """Faults (N,) str with those that are found now, reason -> where (N,); the first one of an episode stays."""
    if not functools.reduce(np.logical_or, found.values()).any():
        return fault
    for reason, where in found.items():
        fault = np.where(where & (fault == ""), reason, fault)
    return fault


def furthest(*conditions: np.ndarray) -> np.ndarray:
    """Number of the last condition (N,) bool that holds, from 1; 0 where none does; (N,) int."""
    found = conditions[0].astype(int)
    for number, held in enumerate(conditions[1:], 2):
        found = np.where(held, number, found)
    return found


def lengths(vectors: np.ndarray) -> np.ndarray:
    """Lengths (...) of vectors (..., K); `np.linalg.norm` takes three times as long."""
    return np.asarray(np.sqrt(np.vecdot(vectors, vectors)))


def jumped(before: TaskState, now: TaskState) -> np.ndarray:
    """Whether the object moved faster than a robot can move it (N,)."""
    most = JUMP_M_S * (now.time_s - before.time_s) + 1e-9
    # Written to be true on NaN.
    return np.asarray(~(lengths(now.place - before.place) <= most))


def rise(start: TaskState, now: TaskState) -> np.ndarray:
    """Height of the object's origin above its start (N,) [m]."""
    return np.asarray(now.world_from_object[:, 2, 3] - start.world_from_object[:, 2, 3])


def apart(one: np.ndarray, other: np.ndarray, symmetry: int) -> np.ndarray:
    """Angles between two rotations (N,) [rad], the smallest among equivalent ones.

    Args:
        one: R_world_object (N, 3, 3).
        other: R_world_object (3, 3), or (N, 3, 3).
        symmetry: Order of the rotational symmetry about the object's own z axis; 0: any rotation.
    """
    if symmetry == 0:
        return np.asarray(np.arccos(clamp(np.vecdot(one[..., 2], other[..., 2]), -1.0, 1.0)))
    turn = one.swapaxes(-1, -2) @ other
    if symmetry == 1:
        return transforms.angles(turn)
    turns = 2.0 * np.pi * np.arange(symmetry) / symmetry
    return np.asarray(np.min([transforms.angles(turn @ lie.about_z(each)) for each in turns], axis=0))
