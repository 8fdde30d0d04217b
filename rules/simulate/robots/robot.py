"""simulate.robot: a robot model from its description as data."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat, model_validator

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import ACCELERATION, Follower, Group, RobotJoint, RobotModel
from dextera_build.errors import listing
from dextera_build.rule import Context, Fraction, Options, rule

from .limbs import GripOptions, LimbOptions, Quaternion, Vector, check_joints, limbs_of
from .operated import HandOptions, with_hands


class PieceOptions(Options):
    """A primitive of a link's visual and collision geometry, in the link's frame."""

    shape: Literal["capsule", "cylinder", "box", "sphere", "ellipsoid"]
    """Kind of primitive."""
    from_m: Vector | None = None
    """One end of a capsule's or cylinder's axis [m]."""
    to_m: Vector | None = None
    """Other end of the axis [m]."""
    at_m: Vector = (0.0, 0.0, 0.0)
    """Centre of any other primitive [m]."""
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Rotation of any other primitive, w x y z."""
    radius_m: NonNegativeFloat = 0.0
    """Radius of a capsule, cylinder or sphere [m]."""
    half_m: tuple[NonNegativeFloat, NonNegativeFloat, NonNegativeFloat] = (0.0, 0.0, 0.0)
    """Half edges of a box, half axes of an ellipsoid [m]."""
    colour: str
    """Name in `colours`."""
    collides: bool = True
    """False: visual only."""
    drawn: bool = True
    """False: collision only."""
    friction: NonNegativeFloat | None = None
    """Sliding friction coefficient of a gripping skin; a contact uses the larger of both sides. None: the other
    side's."""


class JointOptions(Options):
    """A hinge about the link's frame."""

    name: str
    """Name, without the mount's prefix."""
    axis: Vector = (0.0, 0.0, 1.0)
    """Unit axis in the link's frame."""
    lower_rad: float
    """Lower limit [rad]."""
    upper_rad: float
    """Upper limit [rad]."""
    home_rad: float = 0.0
    """Home position [rad]."""
    velocity_rad_s: PositiveFloat
    """Maximum speed [rad/s]."""
    acceleration_rad_s2: PositiveFloat | None = None
    """Maximum acceleration of targets [rad/s^2]; empty: that of the robot."""
    effort_nm: PositiveFloat
    """Maximum torque [N m]."""
    stiffness_nm_rad: NonNegativeFloat
    """Gain of the position actuator [N m/rad]."""
    damping_nms_rad: NonNegativeFloat
    """Damping of joint and actuator [N m s/rad]."""
    armature_kgm2: NonNegativeFloat = 0.0
    """Rotor inertia reflected to the joint [kg m^2]."""
    friction_nm: NonNegativeFloat = 0.0
    """Dry friction [N m]."""


class FollowerOptions(Options):
    """An unactuated hinge about the link's frame, mechanically coupled to an actuated joint."""

    name: str
    """Name, without the mount's prefix."""
    leader: str
    """The joint to follow, in the same copy, without the prefix."""
    ratio: float
    """Rotation per rotation of the leader."""
    offset_rad: float = 0.0
    """Position with the leader at 0 [rad]."""
    axis: Vector = (0.0, 0.0, 1.0)
    """Unit axis in the link's frame."""
    damping_nms_rad: NonNegativeFloat = 0.0
    """Damping [N m s/rad]."""
    armature_kgm2: NonNegativeFloat = 0.0
    """Inertia of the mechanism reflected to the joint [kg m^2]."""


class LinkOptions(Options):
    """One link of a chain."""

    name: str
    """Name, without the mount's prefix."""
    at_m: Vector = (0.0, 0.0, 0.0)
    """Origin in the previous link, or in the mount for a chain's first link [m]."""
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Rotation relative to the previous link, w x y z."""
    mass_kg: NonNegativeFloat
    """Mass [kg]."""
    centre_m: Vector
    """Centre of mass [m]."""
    inertia_kgm2: tuple[NonNegativeFloat, NonNegativeFloat, NonNegativeFloat]
    """Principal moments of inertia [kg m^2]."""
    inertia_quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Rotation of the principal axes, w x y z."""
    joint: JointOptions | None = None
    """The actuated joint, or None for a fixed or following link."""
    follower: FollowerOptions | None = None
    """The joint of a following link."""
    pieces: tuple[PieceOptions, ...]
    """Primitives of the link."""


class MountOptions(Options):
    """The mount of one copy of a chain."""

    parent: str = ""
    """Parent link, with prefix; empty for the world."""
    at_m: Vector = (0.0, 0.0, 0.0)
    """Origin in the parent [m]."""
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Rotation relative to the parent, w x y z."""
    prefix: str = ""
    """Prefix of all names of this copy."""


class ChainOptions(Options):
    """Links in series, built once per mount: four equal fingers are one chain with four mounts."""

    group: Group
    """Morphology class."""
    mounts: tuple[MountOptions, ...]
    """Mounts, one per copy."""
    links: tuple[LinkOptions, ...]
    """Links, from the mount outwards."""


class FrameOptions(Options):
    """A named frame."""

    link: str
    """Link, with prefix."""
    at_m: Vector = (0.0, 0.0, 0.0)
    """Origin in the link [m]."""
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Rotation relative to the link, w x y z."""


class RobotOptions(Options):
    """Options of simulate.robot: the robot as data."""

    name: str
    """Name of the model."""
    source: str
    """Source of kinematics, masses and limits."""
    colours: dict[str, tuple[Fraction, Fraction, Fraction]]
    """Name -> sRGB 0..1."""
    acceleration_rad_s2: PositiveFloat = ACCELERATION
    """Maximum acceleration of the targets of joints that state none, to which motions of arms are slowed [rad/s^2]. By
    default that of the slowest joint of an LBR iiwa, as measured for Drake's model; say in `source` where yours is
    from."""
    chains: tuple[ChainOptions, ...]
    """Chains; the first link of the first chain is named `base` and fixed."""
    frames: dict[str, FrameOptions]
    """Role -> frame: `flange`, `palm`, `tip_index`, ...; of several limbs with their names: `left_palm`."""
    grips: dict[str, GripOptions] = Field(default_factory=dict)
    """Name -> grip of the only hand."""
    limbs: dict[str, LimbOptions] = Field(default_factory=dict)
    """Limb -> properties that do not follow from the roles of `frames`."""
    hands: dict[str, HandOptions] = Field(default_factory=dict)
    """Limb -> how an operator's hand maps to its hand."""
    apart: tuple[tuple[str, str], ...] = ()
    """Pairs of links excluded from contact, in addition to neighbours."""

    @model_validator(mode="after")
    def _moves_its_own_joints(self) -> RobotOptions:
        joints = {
            mount.prefix + link.joint.name
            for chain in self.chains
            for mount in chain.mounts
            for link in chain.links
            if link.joint is not None
        }
        check_joints(self.grips, self.limbs, joints)
        return self


@rule(version=2, packages=("mujoco",))
def robot(ctx: Context, *, options: RobotOptions) -> RobotModel:
    """Return the robot as MJCF of primitives: metres, kilograms, root body `base` in its own frame, z up."""
    from dextera_build.sim.model import robot as builder
    from dextera_build.sim.render import portrait

    links, joints, followers = _inventory(ctx, options)
    text = builder.mjcf(options)
    mass = builder.mass(text)
    ctx.metric("mass", mass, "kg")
    led = f", {len(followers)} followers" if followers else ""
    ctx.say(f"{options.name}: {len(joints)} joints{led}, {len(links)} links, {mass:.1f} kg")
    model = RobotModel(
        model=Folder(files={"robot.xml": text.encode()}),
        joints=joints,
        links=links,
        frames={role: role for role in options.frames},
        source=options.source,
        followers=followers,
    )
    model = with_hands(ctx, limbs_of(ctx, model, options.limbs, options.grips), options.hands)
    ctx.preview(portrait.of_robot(model.model, model.followed(model.home)), "at home")
    return model


def _inventory(
    ctx: Context, options: RobotOptions
) -> tuple[dict[str, Group], tuple[RobotJoint, ...], tuple[Follower, ...]]:
    links: dict[str, Group] = {}
    joints: dict[str, RobotJoint] = {}
    followers: dict[str, Follower] = {}
    for chain in options.chains:
        for mount in chain.mounts:
            if mount.parent and mount.parent not in links:
                ctx.fail(f"`{mount.parent}` carries a chain, but no link is called so", links=listing(links, most=40))
            for link in chain.links:
                name = mount.prefix + link.name
                ctx.check(name not in links, f"two links are called `{name}`", hint="give each mount its own `prefix`")
                _check_pieces(ctx, name, link, options.colours)
                links[name] = chain.group
                if link.joint is not None:
                    joint = _joint(ctx, mount.prefix, link.joint, chain.group, options.acceleration_rad_s2)
                    ctx.check(joint.name not in {*joints, *followers}, f"two joints are called `{joint.name}`")
                    joints[joint.name] = joint
                if link.follower is not None:
                    ctx.check(
                        link.joint is None, f"link `{name}` has a joint and a follower", hint="leave one of them out"
                    )
                    follower = _follower(ctx, mount.prefix, link.follower, chain.group, joints)
                    ctx.check(follower.name not in {*joints, *followers}, f"two joints are called `{follower.name}`")
                    followers[follower.name] = follower
    ctx.check(next(iter(links), "") == "base", "the first link is not called `base`")
    named = {frame.link for frame in options.frames.values()} | {name for pair in options.apart for name in pair}
    if unknown := sorted(named - set(links)):
        ctx.fail(f"no link is called `{unknown[0]}`", links=listing(links, most=40))
    return links, tuple(joints.values()), tuple(followers.values())


def _joint(ctx: Context, prefix: str, joint: JointOptions, group: Group, acceleration: float) -> RobotJoint:
    name = prefix + joint.name
    inside = joint.lower_rad <= joint.home_rad <= joint.upper_rad
    limits = f"{joint.lower_rad:g} to {joint.upper_rad:g} rad"
    ctx.check(inside, f"home of joint `{name}` is outside its limits", home=f"{joint.home_rad:g} rad", limits=limits)
    return RobotJoint(
        name=name,
        group=group,
        lower=joint.lower_rad,
        upper=joint.upper_rad,
        velocity=joint.velocity_rad_s,
        acceleration=joint.acceleration_rad_s2 or acceleration,
        effort=joint.effort_nm,
        home=joint.home_rad,
    )


def _follower(
    ctx: Context, prefix: str, options: FollowerOptions, group: Group, joints: dict[str, RobotJoint]
) -> Follower:
    name, leader = prefix + options.name, prefix + options.leader
    if leader not in joints:
        actuated = listing(joints, most=40)
        ctx.fail(f"`{name}` follows `{leader}`, but no actuated joint before it is called so", joints=actuated)
    return Follower(name=name, group=group, leader=leader, ratio=options.ratio, offset=options.offset_rad)


def _check_pieces(ctx: Context, link: str, options: LinkOptions, colours: dict[str, Vector]) -> None:
    for piece in options.pieces:
        known = piece.colour in colours
        ctx.check(known, f"link `{link}` has an unknown colour `{piece.colour}`", colours=listing(colours))
        if piece.shape in ("capsule", "cylinder"):
            whole = piece.from_m is not None and piece.to_m is not None and piece.radius_m > 0
            ctx.check(whole, f"a {piece.shape} of link `{link}` needs `from_m`, `to_m` and `radius_m`")
        elif piece.shape == "sphere":
            ctx.check(piece.radius_m > 0, f"a sphere of link `{link}` needs `radius_m`")
        else:
            ctx.check(min(piece.half_m) > 0, f"a {piece.shape} of link `{link}` needs `half_m`")
