"""Limbs of a robot: additions of a recipe to the roles of its frames."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Literal

from pydantic import Field, NonNegativeFloat

from dextera_build.artifacts.robots.limb import ONLY, limb_of
from dextera_build.artifacts.robots.robot import Grip, Gripper, Limb, RobotModel
from dextera_build.errors import did_you_mean, listing
from dextera_build.rule import Context, Options

PART = 0.15
"""How far a gripper that pushes is open, as a part of its stroke."""
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class GripOptions(Options):
    """A grip of the hand."""

    against: Literal["thumb", "palm", "nothing"]
    """Opposing side of the grip; `nothing`: the fingers push with their tips."""
    open_rad: dict[str, float]
    """Joint -> position when fully open [rad]."""
    closed_rad: dict[str, float] = Field(default_factory=dict)
    """Joint -> position when closed without an object [rad]."""
    facing: Vector = (0.0, 0.0, -1.0)
    """Unit direction normal to the palm, outwards, in frame `palm`."""
    pointing: Vector = (1.0, 0.0, 0.0)
    """Unit direction along the straight fingers, in frame `palm`."""
    surface_m: float = 0.0
    """Distance of the palm's surface from frame `palm`, along `facing` [m]."""
    tip_radius_m: NonNegativeFloat = 0.0
    """Distance of a finger's surface from its tip frame [m]."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints that it moves."""
        return (*self.open_rad, *self.closed_rad)


class GripperOptions(Options):
    """A parallel gripper."""

    joint: str
    """Actuated joint of both fingers."""
    open: float
    """Its position when fully open [rad, of prismatic joints m]."""
    closed: float = 0.0
    """Its position when closed without an object [rad, of prismatic joints m]."""


class LimbOptions(Options):
    """An arm with its hand. Its joints follow from the bodies between the base and the palm, and beyond the palm."""

    palm: str = ""
    """Role of the palm's frame; empty: `<limb>_palm`, or `palm`."""
    tips: tuple[str, ...] = ()
    """Roles of the fingertip frames; empty: every role that starts with `<limb>_tip_` or `tip_`."""
    tool: str = ""
    """Role of the frame that carries the hand; empty: `<limb>_flange`, or `flange`."""
    gripper: GripperOptions | None = None
    """Parallel gripper of a hand with two fingertips."""
    grips: dict[str, GripOptions] = Field(default_factory=dict)
    """Name -> grip of its hand."""


def check_joints(grips: Mapping[str, GripOptions], limbs: Mapping[str, LimbOptions], joints: Collection[str]) -> None:
    """Raise for grips and grippers with a joint that the robot's own description lacks.

    Args:
        grips: Name -> grip of the only hand.
        limbs: Limb -> options.
        joints: Names of all actuated joints.

    Raises:
        ValueError: A joint is unknown.
    """
    named = [(f"`grips` {name}", joint) for name, grip in grips.items() for joint in grip.joints]
    for limb, options in limbs.items():
        named += [
            (f"`limbs` {limb}, grip {name}", joint) for name, grip in options.grips.items() for joint in grip.joints
        ]
        named += [(f"`limbs` {limb}, gripper", options.gripper.joint)] if options.gripper is not None else []
    for where, joint in named:
        if joint not in joints:
            near = did_you_mean(joint, joints)
            raise ValueError(f"{where}: no joint is called `{joint}`; {near or f'joints: {listing(joints, most=40)}'}")


def limbs_of(
    ctx: Context, robot: RobotModel, limbs: Mapping[str, LimbOptions], grips: Mapping[str, GripOptions]
) -> RobotModel:
    """The robot with its limbs as given by the options.

    Args:
        ctx: Context for errors.
        robot: The robot with the limbs that follow from its frames.
        limbs: Limb -> options; other limbs are unchanged.
        grips: Grips of the only limb.
    """
    found = dict(robot.limbs)
    for name, options in limbs.items():
        found = _named(ctx, robot, found, name, options)
    if grips and len(found) > 1:
        ctx.fail("the robot has several hands", limbs=listing(found), hint="`limbs: {left: {grips: ...}, ...}`")
    for name, limb in found.items():
        stated = limbs.get(name, LimbOptions())
        own = {**grips, **stated.grips}
        gripper = _gripper(ctx, robot, name, limb, stated.gripper)
        every = {**_closing(robot, limb, gripper), **grips_of(ctx, own, robot, limb)}
        found[name] = limb.model_copy(update={"gripper": gripper, "grips": every})
    return robot.model_copy(update={"limbs": found})


def _named(ctx: Context, robot: RobotModel, found: dict[str, Limb], name: str, options: LimbOptions) -> dict[str, Limb]:
    """`found` with the limb `name` from its roles, which replaces a limb of another name without a side."""
    for role in filter(None, (options.palm, options.tool, *options.tips)):
        ctx.check(
            role in robot.frames,
            f"limb `{name}` has no frame `{role}`",
            frames=listing(robot.frames, most=40),
            hint=did_you_mean(role, robot.frames) or f"add `{role}` to `frames`",
        )
    prefix = f"{name}_" if name in found and len(found) > 1 else ""
    if name not in found and not options.palm:
        ctx.check(
            ONLY in found and "palm" in robot.frames,
            f"no frame is the palm of limb `{name}`",
            limbs=listing(found),
            hint=f"add a frame `{name}_palm`, or set `palm`",
        )
    fields = {"model": robot.model, "joints": robot.joints, "links": robot.links, "frames": robot.frames}
    made = limb_of(fields, prefix, palm=options.palm, tips=options.tips, tool=options.tool)
    kept = {other: limb for other, limb in found.items() if limb.palm != made.palm or other == name}
    return {**kept, name: made}


def grips_of(ctx: Context, grips: Mapping[str, GripOptions], robot: RobotModel, limb: Limb) -> dict[str, Grip]:
    """The grips of a limb, which move joints of its hand within their limits."""
    hand = {joint.name: joint for joint in robot.joints if joint.name in limb.hand}
    for name, grip in grips.items():
        for joint, position in [*grip.open_rad.items(), *grip.closed_rad.items()]:
            ctx.check(
                joint in hand,
                f"grip `{name}` moves `{joint}`, which is not a joint of the hand",
                joints=listing(hand, most=40),
                hint=did_you_mean(joint, hand) or "name joints of this hand in `open_rad` and `closed_rad`",
            )
            inside = hand[joint].lower <= position <= hand[joint].upper
            limits = f"{hand[joint].lower:g} to {hand[joint].upper:g} rad"
            ctx.check(inside, f"grip `{name}` bends `{joint}` beyond its limits", position=position, limits=limits)
    return {
        name: Grip(
            against=grip.against,
            open=grip.open_rad,
            closed=grip.closed_rad,
            facing=grip.facing,
            pointing=grip.pointing,
            surface_m=grip.surface_m,
            tip_radius_m=grip.tip_radius_m,
        )
        for name, grip in grips.items()
    }


def _gripper(ctx: Context, robot: RobotModel, name: str, limb: Limb, options: GripperOptions | None) -> Gripper | None:
    if options is None:
        return None
    hand = {joint.name: joint for joint in robot.joints if joint.name in limb.hand}
    ctx.check(
        options.joint in hand,
        f"the gripper of `{name}` has no joint `{options.joint}`",
        joints=listing(hand, most=40),
        hint=did_you_mean(options.joint, hand) or "set `joint` to one of this hand",
    )
    joint = hand[options.joint]
    inside = all(joint.lower <= each <= joint.upper for each in (options.open, options.closed))
    limits = f"{joint.lower:g} to {joint.upper:g}"
    ctx.check(inside, f"the gripper of `{name}` opens beyond the limits of `{options.joint}`", limits=limits)
    ctx.check(
        len(limb.tips) == 2,
        f"the gripper of `{name}` has {len(limb.tips)} fingertips, not two",
        tips=listing(limb.tips) or "none",
        hint=f"add the frames `{name}_tip_left` and `{name}_tip_right`",
    )
    return Gripper(joint=options.joint, open=options.open, closed=options.closed)


def _closing(robot: RobotModel, limb: Limb, gripper: Gripper | None) -> dict[str, Grip]:
    """The grips of a parallel gripper whose palm frame has z towards the object: it pinches, and pushes when closed."""
    if gripper is None:
        return {}
    from dextera_build.sim.model import fingertips

    ahead = (0.0, 0.0, 1.0)
    opened, closed = {gripper.joint: gripper.open}, {gripper.joint: gripper.closed}
    # Fingers that press on one another would be in collision on the whole way.
    pushing = {gripper.joint: gripper.closed + PART * (gripper.open - gripper.closed)}
    point = Grip(against="nothing", open=pushing, facing=(1.0, 0.0, 0.0), pointing=ahead)
    if limb.palm:
        point = point.model_copy(update={"tip_radius_m": fingertips.half_width(robot, limb, pushing)})
    return {"pinch": Grip(against="thumb", open=opened, closed=closed, facing=ahead, pointing=ahead), "point": point}
