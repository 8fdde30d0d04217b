"""Task bundles: an embodiment, a scene and a primitive, ready to run."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from dextera_build.artifacts.base import Array, Artifact, Folder, Value
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.core.frames import Frames
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.artifacts.tasks.goals import Goal

WorldKind = Literal["twin", "reference", "perturbed", "real"]
"""`twin`: built from the capture. `reference`: a simulated world with its own truth and physics, a substitute for
hardware. `perturbed`: the twin with disturbed geometry and physics, if no reference world exists. `real`: a robot, of
which only recordings exist."""


ActionKind = Literal["joint", "delta", "end_effector"]
"""Kind of the actions, see `dextera_build.policy.actions`."""


class Reset(Value):
    """Start distribution: half ranges around the photographed configuration."""

    position_m: float = 0.0
    """The task's object is placed within this square half width on the support [m]."""
    yaw_rad: float = 0.0
    """... and rotated within this angle about the vertical [rad]."""
    clutter_m: float = 0.0
    """Every other object is placed within this square half width [m]."""
    joint_rad: float = 0.0
    """Joints of the task's object start within this range around the photographed position [rad or m]."""
    robot_rad: float = 0.0
    """Every joint of the robot starts within this range around its home [rad]."""
    dynamics: float = 1.0
    """Masses, sizes, friction and gains are drawn from this fraction of the twin's own intervals, and pose errors of
    the objects and of the robot's base from this fraction of their standard deviations; 0 keeps the estimates."""
    joints: float = 0.0
    """Damping and friction of joints, of robot and objects, are drawn from this fraction of their ranges, see
    `dextera_build.sim.runtime.variations`."""
    goal_m: float = 0.0
    """The target is placed within this square half width on the support, and a lift height varies within it [m]."""
    goal_rad: float = 0.0
    """A target orientation is rotated about the vertical within this angle, and joint commands vary within it [rad]."""
    visual: float = 0.0
    """Errors of cameras are drawn from this fraction of the standard deviations of their calibration; exposure,
    light and noise from this fraction of their ranges. A `View.photographed` follows the base instead if that has
    an error."""


class TaskSpec(Value):
    """The objective; the same in every world."""

    name: str
    """`CloseLaptop`."""
    object: str
    """Root body of the task's object."""
    goal: Goal
    """The goal, which names the primitive."""
    limbs: tuple[str, ...] = ()
    """Limbs that must act, jointly if several are named; empty: any."""
    hold_s: float = 0.5
    """Time for which the condition must hold without interruption [s]; the same in every world."""
    timeout_s: float = 8.0
    """Time limit: an episode without success by then has failed [s]."""
    control_hz: float = 20.0
    """Rate of observations and actions [Hz]."""
    action: ActionKind = "joint"
    """Kind of actions of the Gymnasium environment and of LeRobot data sets; the robot itself is moved by joint
    targets."""
    reset: Reset = Reset()
    """Start distribution."""

    @property
    def primitive(self) -> str:
        """Kind of objective."""
        return self.goal.primitive


class Cavity(Artifact):
    """The cavity of an upright container, by columns of a grid: open above, closed below and around."""

    corner_m: tuple[float, float]
    """x and y of the grid's first corner, in the object's frame [m]."""
    cell_m: float
    """Edge of a column [m]."""
    floor_m: Annotated[np.ndarray, Array("X Y", "float32", unit="m", frame="object")]
    """Height of the surface below the cavity; that of `rim_m` outside the cavity."""
    rim_m: Annotated[np.ndarray, Array("X Y", "float32", unit="m", frame="object")]
    """Height of the lowest rim over which water would flow out of this column."""

    def sized(self, factor: float) -> Cavity:
        """The cavity with all lengths multiplied by `factor`."""
        x, y = self.corner_m
        heights = {name: getattr(self, name) * np.float32(factor) for name in ("floor_m", "rim_m")}
        return self.model_copy(update={"corner_m": (x * factor, y * factor), "cell_m": self.cell_m * factor, **heights})


class TaskObject(Artifact):
    """One movable object of a task's model."""

    joints: tuple[str, ...]
    """Joints inside the object, in the order of the model."""
    pose: Annotated[Pose, Frames("world", "object")]
    """T_world_object in the photograph."""
    positions: tuple[float, ...]
    """Joint positions in the photograph [rad or m]."""
    mass_scale: tuple[float, float]
    """Interval of the true mass relative to the estimate (90 %)."""
    scale_sigma: float | None = None
    """Standard deviation of the log of all its lengths; None if unknown, in which case starts keep the estimate."""
    friction: float
    """Sliding friction coefficient, estimate."""
    friction_sigma: float
    """Standard deviation of `friction`."""
    points: Annotated[np.ndarray, Array("P 3", "float32", unit="m", frame="object")]
    """Points sampled on its surface by area, joints as in the photograph."""
    cavity: Cavity | None = None
    """The cavity of a container; None if it is not needed."""

    def sized(self, factor: float) -> TaskObject:
        """The object with all lengths of its shape multiplied by `factor`, as drawn by a start."""
        if factor == 1.0:
            return self
        room = None if self.cavity is None else self.cavity.sized(factor)
        return self.model_copy(update={"points": self.points * np.float32(factor), "cavity": room})


class TaskBundle(Artifact):
    """A task that can be simulated. The world frame is the twin's: z up, the support is z = 0.

    In a reference or perturbed world every body and joint has its name and frame from the twin, as if the twin's assets
    were tracked there, so that states, actions and success have the same meaning.
    """

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

    latency_s: float = 0.0
    """Time from a command to its effect in this world [s]."""
    gain_share: dict[str, float] = Field(default_factory=dict)
    """Joint -> fraction of the range of the gains that starts draw from, after they were identified; 1 for others."""

    @property
    def displacement_names(self) -> tuple[str, ...]:
        """Joints inside the objects, in the order of the objects."""
        return tuple(name for thing in self.objects.values() for name in thing.joints)


class View(Artifact):
    """A camera of policies and films."""

    camera: Camera
    """Intrinsics at the rendered size."""
    camera_pose: Annotated[Pose, Frames("world", "camera")]
    """T_world_camera, OpenCV axes."""
    samples: int = 1
    """Samples per pixel of its pictures."""
    photographed: bool = False
    """Whether it is the camera of the twin's photograph, from which the base's pose is known. If a start has an
    error of the base, such a camera keeps its pose relative to the objects, because the error is that of its
    calibration."""
