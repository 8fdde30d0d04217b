"""Interface of a primitive: its options, goal, conditions of success and failure, and the value of a state.

A primitive is a folder with a file `primitive.py`, which defines the classes `Options` and `Primitive`, derived from
those here; see docs/primitives.md. Its conditions use only quantities that can be measured in any world, so that
simulator, tracker and hardware are judged by the same code.
"""

from __future__ import annotations

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
from dextera_build.sim.primitives.state import TaskState

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


@dataclass(frozen=True)
class Past:
    """Summary of an episode so far; a function of its states."""

    before: TaskState
    """State of the previous control period."""
    stage: int = 0
    """Stage reached, numbered by the primitive."""
    fault: str = ""
    """Reason why the episode can no longer succeed."""
    mark: np.ndarray | None = None
    """A position (3,) in the world, stored by the primitive [m]."""


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
    carries: ClassVar[bool] = True
    """Whether hands carry the object's weight, so that a heavy one is harder than a light one."""
    still: ClassVar[Literal["", "in hand", "on support"]] = ""
    """Reference against which its object should not move; empty if the object is to be moved to a target."""
    hands: ClassVar[int] = 1
    """Minimum number of hands."""
    against: ClassVar[tuple[str, ...]] = ("thumb", "palm")
    """Grips with which a trained policy begins, preferred first, see `Grip.against`."""

    def __init__(self, task: TaskSpec, objects: Mapping[str, TaskObject] | None = None) -> None:
        self.task = task
        goal: Any = task.goal
        if not isinstance(goal, self.goal_type):  # as it comes from the store
            goal = self.goal_type.model_validate(goal.model_dump())
        self.goal: G = goal
        self.objects = objects or {}

    @abstractmethod
    def holds(self, start: TaskState, now: TaskState, past: Past) -> bool:
        """Whether the condition holds now.

        Args:
            start: State at the reset.
            now: Current state.
            past: Summary of the states from `start` to `now`, inclusive.
        """

    def follow(self, past: Past, start: TaskState, now: TaskState) -> Past:
        """The summary updated with the state `now`."""
        return Past(now, past.stage, past.fault, past.mark)

    @abstractmethod
    def missing(self, start: TaskState, now: TaskState, past: Past) -> str:
        """The condition not met at the time limit: a few words without numbers, the same for every such episode."""

    @abstractmethod
    def value(self, reach_m: float, start: TaskState, now: TaskState, *, success: bool) -> float:
        """Value of a state, see `stages`.

        Args:
            reach_m: Distance of the fingertips from their target on the object [m].
            start: State at the reset.
            now: Current state.
            success: Whether the task is done.
        """

    def fair(self, places: Mapping[str, np.ndarray]) -> bool:
        """Whether an episode may begin with the bodies at these poses (4, 4): the goal must not be reached yet."""
        return True

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

    def pushed(self, start: TaskState, now: TaskState) -> tuple[str, float] | None:
        """Joint to move next and by how much [rad or m]; None: the object itself is the target of reaching."""
        return None


def jumped(before: TaskState, now: TaskState) -> bool:
    """Whether the object moved faster than a robot can move it."""
    moved = now.world_from_object[:3, 3] - before.world_from_object[:3, 3]
    # Written to be true on NaN.
    return not float(np.linalg.norm(moved)) <= JUMP_M_S * max(now.time_s - before.time_s, 0.0) + 1e-9


def rise(start: TaskState, now: TaskState) -> float:
    """Height of the object's origin above its start [m]."""
    return float(now.world_from_object[2, 3] - start.world_from_object[2, 3])


def apart(one: np.ndarray, other: np.ndarray, symmetry: int) -> float:
    """Angle between two rotations (3, 3) [rad], the smallest among equivalent ones.

    Args:
        one: R_world_object.
        other: R_world_object.
        symmetry: Order of the rotational symmetry about the object's own z axis; 0: any rotation.
    """
    if symmetry == 0:
        return float(np.arccos(clamp(float(one[:, 2] @ other[:, 2]), -1.0, 1.0)))
    if symmetry == 1:
        return transforms.angle(one.T @ other)
    turns = 2.0 * np.pi * np.arange(symmetry) / symmetry
    return min(transforms.angle(one.T @ other @ lie.about_z(turn)) for turn in turns)
