"""Robots: a kinematic model that loads in MuJoCo, with its joints, frames and limbs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from pydantic import Field, model_validator

from dextera_build.artifacts.base import Artifact, Folder, Value
from dextera_build.artifacts.robots.hand_map import HandMap as HandMap
from dextera_build.artifacts.robots.limb import ACCELERATION as ACCELERATION
from dextera_build.artifacts.robots.limb import Grip as Grip
from dextera_build.artifacts.robots.limb import Gripper as Gripper
from dextera_build.artifacts.robots.limb import Group as Group
from dextera_build.artifacts.robots.limb import Limb as Limb
from dextera_build.artifacts.robots.limb import RobotJoint as RobotJoint
from dextera_build.artifacts.robots.limb import limbs_of


class Follower(Value):
    """An unactuated joint that is mechanically coupled to an actuated one: position = `ratio` x leader + `offset`."""

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


class RobotModel(Artifact):
    """A robot as data."""

    model: Folder
    """`robot.xml` (MJCF) and the files that it names, relative; root body `base`, fixed to the world, z up."""
    joints: tuple[RobotJoint, ...]
    """Actuated joints in the order of the MJCF's position actuators."""
    links: dict[str, Group]
    """MJCF body -> class; the base belongs to the arm."""
    frames: dict[str, str]
    """Role -> MJCF site: `flange`, `palm`, a fingertip per finger; of several limbs with their names first:
    `left_palm`."""
    source: str
    """Source of kinematics, masses and limits."""
    limbs: dict[str, Limb] = Field(default_factory=dict)
    """Name -> limb: `left` and `right`, or `arm`. By default they follow from the roles of `frames`, see `limbs_of`."""
    hands: dict[str, HandMap] = Field(default_factory=dict)
    """Limb -> how an operator's hand maps to its hand, as far as the recipe states it."""
    followers: tuple[Follower, ...] = ()
    """Joints that move with an actuated one; they are not part of an action."""

    @property
    def model_name(self) -> str:
        """Name of its MJCF; `unknown` without one."""
        head = self.model.files.get("robot.xml", b"")[:4096].decode(errors="replace")
        named = re.search(r'<mujoco[^>]*\smodel="([^"]+)"', head)
        return named[1] if named else "unknown"

    @property
    def home(self) -> dict[str, float]:
        """Joint -> home position [rad or m]."""
        return {joint.name: joint.home for joint in self.joints}

    def names(self, group: Group) -> tuple[str, ...]:
        """Joints of one class, in order."""
        return tuple(joint.name for joint in self.joints if joint.group == group)

    @property
    def limb_names(self) -> tuple[str, ...]:
        """Names of the limbs, in the order of all arrays by limb; the store sorts keys of dictionaries as text."""
        return tuple(sorted(self.limbs))

    @property
    def tips(self) -> tuple[str, ...]:
        """Roles of the fingertips of all limbs among `frames`, in order."""
        return tuple(role for name in self.limb_names for role in self.limbs[name].tips)

    def limb_home(self, name: str) -> dict[str, float]:
        """Joint of a limb -> home position [rad or m]."""
        limb = self.limbs[name]
        return {joint: position for joint, position in self.home.items() if joint in (*limb.arm, *limb.hand)}

    def followed(self, joints: Mapping[str, float]) -> dict[str, float]:
        """`joints` with the position of every follower whose leader is among them [rad or m]."""
        led = {
            follower.name: follower.ratio * joints[follower.leader] + follower.offset
            for follower in self.followers
            if follower.leader in joints
        }
        return {**joints, **led}

    @model_validator(mode="before")
    @classmethod
    def _with_limbs(cls, fields: dict[str, Any]) -> dict[str, Any]:
        if fields.get("limbs"):
            return fields
        return {**fields, "limbs": limbs_of(fields)}
