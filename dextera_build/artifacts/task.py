"""Task bundles: an embodiment, a scene and a primitive, ready to run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from dextera_build.artifacts import former, goals
from dextera_build.artifacts.base import Array, Artifact, Folder, Value
from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.frames import Frames
from dextera_build.artifacts.goals import Goal
from dextera_build.artifacts.goals import Primitive as Primitive
from dextera_build.artifacts.packed import pack
from dextera_build.artifacts.pose import Pose
from dextera_build.artifacts.robot import RobotModel

WorldKind = Literal["twin", "reference", "perturbed"]
"""`twin`: built from the capture. `reference`: a simulated world with its own truth and physics, the stand-in for
hardware. `perturbed`: the twin with disturbed geometry and physics, if no reference world exists. None is real."""


ActionKind = Literal["joint", "delta", "end_effector"]
"""What the numbers of an action are, see `dextera_build.policy.actions`."""


class Reset(Value):
    """How an episode begins: half ranges around the photograph's configuration."""

    position_m: float = 0.0
    """The task's object moves within this square half width on the support [m]."""
    yaw_rad: float = 0.0
    """... and turns within this angle about the vertical [rad]."""
    clutter_m: float = 0.0
    """Every other object moves within this square half width [m]."""
    joint_rad: float = 0.0
    """Joints of the task's object start within this range around the photograph's position [rad or m]."""
    robot_rad: float = 0.0
    """Every joint of the robot starts within this range around its home [rad]."""
    dynamics: float = 1.0
    """Masses, sizes, friction and gains are drawn within this many of the twin's own intervals, and errors of the
    poses of the objects and of the robot's base have this many of their standard deviations; 0 keeps the estimates."""
    joints: float = 0.0
    """Damping and friction of joints, the robot's and the objects', are drawn within this many of their ranges, see
    `dextera_build.sim.runtime.variations`."""
    goal_m: float = 0.0
    """The target moves within this square half width on the support, and a height to lift within it [m]."""
    goal_rad: float = 0.0
    """A target orientation turns about the vertical within this angle, commands of joints change within it [rad]."""
    visual: float = 0.0
    """Errors of cameras have this many of the standard deviations of their calibration; exposure, light and noise are
    drawn within this many of their ranges. A `View.photographed` follows the base instead where that has an error."""


class TaskSpec(Value):
    """The objective; the same in every world."""

    name: str
    """`CloseLaptop`."""
    object: str
    """Root body that the task is about."""
    goal: Goal = Field(discriminator="primitive")
    """What is to be reached; its type is the primitive."""
    limbs: tuple[str, ...] = ()
    """Limbs that must do it, together if there are several; empty: any."""
    hold_s: float = 0.5
    """The condition must hold without a break for this long at the end [s]; the same in every world."""
    timeout_s: float = 8.0
    """Time limit: an episode without success by then has failed [s]."""
    control_hz: float = 20.0
    """Rate of observations and actions [Hz]."""
    action: ActionKind = "joint"
    """Kind of the actions that Gymnasium takes and data sets for LeRobot hold; the robot is moved by joint targets."""
    reset: Reset = Reset()
    """Start distribution."""

    @property
    def primitive(self) -> Primitive:
        """Kind of objective."""
        return self.goal.primitive

    @model_validator(mode="before")
    @classmethod
    def _with_goal(cls, fields: dict[str, Any]) -> dict[str, Any]:
        """Specs that were stored before there were goals state the fields of both primitives instead."""
        if "primitive" not in fields:
            return fields
        parts = {name: fields[name] for name in ("primitive", "height_m", "joints", "tolerance") if name in fields}
        rest = {name: value for name, value in fields.items() if name not in parts}
        return {**rest, "goal": goals.former(**parts)}


class Cavity(Artifact):
    """The room inside a container that stands upright, by columns of a grid: open above, closed below and around."""

    corner_m: tuple[float, float]
    """x and y of the grid's first corner, in the object's frame [m]."""
    cell_m: float
    """Edge of a column [m]."""
    floor_m: Annotated[np.ndarray, Array("X Y", "float32", unit="m", frame="object")]
    """Height of the surface below the room; that of `rim_m` where there is no room."""
    rim_m: Annotated[np.ndarray, Array("X Y", "float32", unit="m", frame="object")]
    """Height of the lowest rim over which water would run out of this column."""

    def sized(self, factor: float) -> Cavity:
        """The room with all lengths times `factor`."""
        x, y = self.corner_m
        heights = {name: getattr(self, name) * np.float32(factor) for name in ("floor_m", "rim_m")}
        return self.model_copy(update={"corner_m": (x * factor, y * factor), "cell_m": self.cell_m * factor, **heights})


class TaskObject(Artifact):
    """One movable object of a task's model."""

    type_version: ClassVar[int] = 4
    readers: ClassVar[former.Readers] = {
        1: former.pose("world_from_object", "pose", "world", "object"),
        2: former.unchanged,
        3: former.unchanged,
    }

    joints: tuple[str, ...]
    """Joints inside the object, in the order of the model."""
    pose: Annotated[Pose, Frames("world", "object")]
    """T_world_object in the photograph."""
    positions: tuple[float, ...]
    """Joint positions in the photograph [rad or m]."""
    mass_scale: tuple[float, float]
    """Interval of the true mass over the estimate (90 %)."""
    scale_sigma: float | None = None
    """Standard deviation of the log of all its lengths; None if unknown, and starts keep the estimate."""
    friction: float
    """Sliding friction coefficient, estimate."""
    friction_sigma: float
    """Standard deviation of `friction`."""
    points: Annotated[np.ndarray, Array("P 3", "float32", unit="m", frame="object")]
    """Points sampled on its surface by area, joints as in the photograph."""
    cavity: Cavity | None = None
    """The room inside a container; None where nothing asks for it."""

    def sized(self, factor: float) -> TaskObject:
        """The object with all lengths of its shape times `factor`, as a start draws it."""
        if factor == 1.0:
            return self
        room = None if self.cavity is None else self.cavity.sized(factor)
        return self.model_copy(update={"points": self.points * np.float32(factor), "cavity": room})


class TaskBundle(Artifact):
    """A task that can be simulated. The world frame is the twin's: z up, the support is z = 0.

    In a reference or perturbed world every body and joint has its name and frame from the twin, as if the twin's
    assets were tracked there: states, actions and success have the same meaning.
    """

    type_version: ClassVar[int] = 5
    readers: ClassVar[former.Readers] = {
        1: former.pose("world_from_base", "base_pose", "world", "base"),
        2: former.unchanged,
        3: former.unchanged,
        4: former.unchanged,
    }

    model: Folder
    """`scene.xml` and its files: scene and robot, whose names begin with `robot/`. No camera: see `View`."""
    robot: RobotModel
    """The embodiment; its joints are the action space, in this order."""
    base_pose: Annotated[Pose, Frames("world", "base")]
    """T_world_base of the robot."""
    task: TaskSpec
    """The objective."""
    objects: dict[str, TaskObject]
    """Root body -> object, all movable ones."""
    kind: WorldKind = "twin"
    """Kind of this world."""

    def export(self, folder: str | Path, stem: str) -> list[Path]:
        """Write every part in its own format, and the whole as `stem.bundle`, which `gymnasium.make` accepts."""
        folder = Path(folder)
        written = super().export(folder, stem)
        written.append(folder / f"{stem}.bundle")
        written[-1].write_bytes(pack(self))
        return written

    latency_s: float = 0.0
    """Time from a command to its effect in this world [s]."""

    @property
    def goal_numbers(self) -> tuple[float, ...]:
        """The goal as policies see it, in the base frame; `TaskSpec.goal` names the numbers."""
        return self.task.goal.numbers(self.base_pose.inverse().matrix)

    @property
    def displacement_names(self) -> tuple[str, ...]:
        """Joints inside the objects, in the order of the objects."""
        return tuple(name for thing in self.objects.values() for name in thing.joints)


def _of_the_photograph(fields: former.Fields) -> former.Fields:
    """Version 2 did not say it: only the photograph's camera had a covariance."""
    return {**fields, "photographed": fields["camera_pose"].covariance is not None}


class View(Artifact):
    """A camera of policies and films."""

    type_version: ClassVar[int] = 3
    readers: ClassVar[former.Readers] = {
        1: former.pose("world_from_camera", "camera_pose", "world", "camera"),
        2: _of_the_photograph,
    }

    camera: Camera
    """Intrinsics at the size that is rendered."""
    camera_pose: Annotated[Pose, Frames("world", "camera")]
    """T_world_camera, OpenCV axes."""
    samples: int = 1
    """Samples per pixel of its pictures."""
    photographed: bool = False
    """Whether it is the camera of the twin's picture, by which the base's pose is known. Where a start has an error of
    the base, such a camera stays with the objects that it saw: the error is that of its calibration."""
