"""Robots: a kinematic model that loads in MuJoCo, and what people need to know of it."""

from __future__ import annotations

from typing import Literal

from dextera_build.artifacts.base import Artifact, Folder, Value

Group = Literal["arm", "hand"]
"""Morphology class of a link or joint; alignment weighs the two equally."""


class RobotJoint(Value):
    """One actuated joint."""

    name: str
    """Name in the MJCF."""
    group: Group
    """Arm or hand."""
    lower: float
    """Lower limit [rad or m]."""
    upper: float
    """Upper limit [rad or m]."""
    velocity: float
    """Largest speed [rad/s or m/s]."""
    effort: float
    """Largest torque or force [N m or N]."""
    home: float
    """Home position [rad or m]."""


class RobotModel(Artifact):
    """A robot as data (mission rows A2, F1, F2)."""

    model: Folder
    """`robot.xml` (MJCF) and the files that it names, relative; root body `base`, fixed to the world, z up."""
    joints: tuple[RobotJoint, ...]
    """Actuated joints in the order of the MJCF's position actuators."""
    links: dict[str, Group]
    """MJCF body -> class; the base belongs to the arm."""
    frames: dict[str, str]
    """Role -> MJCF site: `flange`, `palm`, and a fingertip per finger."""
    source: str
    """Where kinematics, masses and limits come from."""

    @property
    def home(self) -> dict[str, float]:
        """Joint -> home position [rad or m]."""
        return {joint.name: joint.home for joint in self.joints}

    def names(self, group: Group) -> tuple[str, ...]:
        """Joints of one class, in order."""
        return tuple(joint.name for joint in self.joints if joint.group == group)
