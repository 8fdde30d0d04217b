"""Limbs of robots: an arm with its hand, by the names of its joints and the roles of its frames."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field

from dextera_build.artifacts.core.value import Value
from dextera_build.artifacts.robots import kinematic_tree

Group = Literal["arm", "hand"]
"""Morphology class of a link or joint; alignment weights the two equally."""
ONLY = "arm"
"""Name of the limb of a robot whose frames have no side."""


ACCELERATION = 8.5
"""Acceleration of a joint that states none [rad/s^2 or m/s^2]. Makers of arms state speeds and torques, but seldom
accelerations; the least accelerated joint of an LBR iiwa was measured at 8.57 rad/s^2 (Drake's model of it)."""


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
    acceleration: float = ACCELERATION
    """Largest acceleration of targets, to which motions of arms are slowed [rad/s^2 or m/s^2]."""


class Grip(Value):
    """A grip of the hand: finger postures by joint, and directions of the hand in its frame `palm`."""

    against: Literal["thumb", "palm", "nothing"]
    """The opposing side of the grip; `nothing`: the fingers push with their tips."""
    open: dict[str, float]
    """Joint -> position when fully open [rad]; omitted joints are at home."""
    closed: dict[str, float] = Field(default_factory=dict)
    """Joint -> position when closed without an object [rad]; omitted joints stay as in `open`."""
    facing: tuple[float, float, float] = (0.0, 0.0, -1.0)
    """Unit direction normal to the palm, outwards."""
    pointing: tuple[float, float, float] = (1.0, 0.0, 0.0)
    """Unit direction along the straight fingers."""
    surface_m: float = 0.0
    """Distance of the palm's surface from the palm's frame, along `facing` [m]."""
    tip_radius_m: float = 0.0
    """Distance of a finger's surface from its tip frame [m]."""


class Gripper(Value):
    """A parallel gripper: one joint moves two opposing fingertips."""

    joint: str
    """Actuated joint; the other finger follows it."""
    open: float
    """Its position when fully open [rad or m]."""
    closed: float
    """Its position when closed without an object [rad or m]."""


class Limb(Value):
    """An arm with its hand. A joint that moves several arms belongs to each of them."""

    arm: tuple[str, ...]
    """Actuated joints from the base to the palm, in the robot's order."""
    hand: tuple[str, ...]
    """Actuated joints of the hand, in the robot's order."""
    palm: str = ""
    """Role of the palm among the robot's `frames`; empty if there is none."""
    tips: tuple[str, ...] = ()
    """Roles of the fingertips, in order; a parallel gripper has two."""
    tool: str = ""
    """Role of the frame that carries the hand; empty if there is none."""
    gripper: Gripper | None = None
    """The parallel gripper of its hand; None for a hand with fingers."""
    grips: dict[str, Grip] = Field(default_factory=dict)
    """Name -> grip: `pinch`, `wrap`, `point`."""

    @property
    def thumb(self) -> str | None:
        """Role of the fingertip that opposes the others: the thumb's, or the first of a parallel gripper."""
        named = next((role for role in self.tips if role.endswith("tip_thumb")), None)
        return self.tips[0] if named is None and self.gripper is not None and self.tips else named

    @property
    def fingers(self) -> tuple[str, ...]:
        """Roles of the fingertips that oppose the thumb."""
        return tuple(role for role in self.tips if role != self.thumb)


def limbs_of(fields: Mapping[str, Any]) -> dict[str, Limb]:
    """The limbs of a robot from the roles of its frames: one for every `<limb>_palm`, else one with all joints.

    Args:
        fields: `model`, `joints`, `links` and `frames` of a `RobotModel`.
    """
    frames: Mapping[str, str] = fields.get("frames", {})
    names = sorted(role.removesuffix("_palm") for role in frames if role.endswith("_palm"))
    if not names:
        return {ONLY: limb_of(fields, "")}
    return {name: limb_of(fields, f"{name}_") for name in names}


def limb_of(
    fields: Mapping[str, Any], prefix: str, *, palm: str = "", tips: tuple[str, ...] = (), tool: str = ""
) -> Limb:
    """One limb of a robot, with the joints between the base and its palm, and below its hand.

    Args:
        fields: `model`, `joints`, `links` and `frames` of a `RobotModel`.
        prefix: Prefix of the roles of its frames; empty for the only limb.
        palm: Role of the palm; empty: `palm` with the prefix, if there is one.
        tips: Roles of the fingertips; empty: every role that starts with the prefix and `tip_`.
        tool: Role of the frame that carries the hand; empty: `flange` with the prefix, if there is one.
    """
    frames: Mapping[str, str] = fields.get("frames", {})
    palm = palm or (f"{prefix}palm" if f"{prefix}palm" in frames else "")
    tool = tool or (f"{prefix}flange" if f"{prefix}flange" in frames else "")
    tips = tips or tuple(role for role in frames if role.startswith(f"{prefix}tip_"))
    joints = [joint if isinstance(joint, RobotJoint) else RobotJoint(**joint) for joint in fields["joints"]]
    groups = {joint.name: joint.group for joint in joints}
    chain = kinematic_tree.chain(fields["model"], frames[palm], fields["links"]) if palm else None
    if chain is None:  # no palm, or a description without bodies: use the names
        mine = {name for name in groups if name.startswith(prefix)}
        above, below = mine, mine
    else:
        above, below = chain
    return Limb(
        arm=tuple(name for name, group in groups.items() if group == "arm" and name in above),
        hand=tuple(name for name, group in groups.items() if group == "hand" and name in below),
        palm=palm,
        tips=tips,
        tool=tool,
    )
