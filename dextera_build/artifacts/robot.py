"""Robots: a kinematic model that loads in MuJoCo, with its joints, frames and grips."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from pydantic import Field

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


class Follower(Value):
    """A joint without a motor that a mechanism couples to an actuated one: position = `ratio` x leader + `offset`."""

    name: str
    """Name in the MJCF."""
    group: Group
    """Arm or hand."""
    leader: str
    """Actuated joint that it follows."""
    ratio: float
    """Its motion per motion of the leader."""
    offset: float = 0.0
    """Its position when the leader is at 0 [rad or m]."""


class Grip(Value):
    """A way to use the hand, as data: finger postures by joint, and directions of the hand in its frame `palm`."""

    against: Literal["thumb", "palm", "nothing"]
    """The opposing side of the grip; `nothing`: the fingers push with their tips."""
    open: dict[str, float]
    """Joint -> position at its widest [rad]; joints left out are at home."""
    closed: dict[str, float] = Field(default_factory=dict)
    """Joint -> position with nothing in the hand [rad]; joints left out stay as in `open`."""
    facing: tuple[float, float, float] = (0.0, 0.0, -1.0)
    """Unit direction out of the palm."""
    pointing: tuple[float, float, float] = (1.0, 0.0, 0.0)
    """Unit direction along the straight fingers."""
    surface_m: float = 0.0
    """Distance of the palm's surface from the palm's frame, along `facing` [m]."""
    tip_radius_m: float = 0.0
    """Distance of a finger's surface from its tip frame [m]."""


class RobotModel(Artifact):
    """A robot as data."""

    model: Folder
    """`robot.xml` (MJCF) and the files that it names, relative; root body `base`, fixed to the world, z up."""
    joints: tuple[RobotJoint, ...]
    """Actuated joints in the order of the MJCF's position actuators."""
    links: dict[str, Group]
    """MJCF body -> class; the base belongs to the arm."""
    frames: dict[str, str]
    """Role -> MJCF site: `flange`, `palm`, a fingertip per finger; of two arms also as `left_...` and `right_...`."""
    source: str
    """Source of kinematics, masses and limits."""
    grips: dict[str, Grip] = Field(default_factory=dict)
    """Name -> a way to use the hand: `pinch`, `wrap`, `point`."""
    followers: tuple[Follower, ...] = ()
    """Joints that move with an actuated one; they are not part of an action."""

    @property
    def home(self) -> dict[str, float]:
        """Joint -> home position [rad or m]."""
        return {joint.name: joint.home for joint in self.joints}

    def names(self, group: Group) -> tuple[str, ...]:
        """Joints of one class, in order."""
        return tuple(joint.name for joint in self.joints if joint.group == group)

    @property
    def tips(self) -> tuple[str, ...]:
        """Roles of the fingertips among `frames`, in order."""
        return tuple(role for role in self.frames if role.startswith("tip_"))

    def followed(self, joints: Mapping[str, float]) -> dict[str, float]:
        """`joints` with the position of every follower whose leader is among them [rad or m]."""
        led = {
            follower.name: follower.ratio * joints[follower.leader] + follower.offset
            for follower in self.followers
            if follower.leader in joints
        }
        return {**joints, **led}
