"""simulate.imported_robot: a robot out of URDF and MJCF files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from pydantic import Field, NonNegativeFloat, PositiveFloat

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robot import RobotModel
from dextera_build.errors import listing
from dextera_build.rule import Context, Options, rule

from . import imported_parts
from .robot import FrameOptions, GripOptions, Quaternion, Vector, grips_of

if TYPE_CHECKING:
    from dextera_build.sim.model.imported.assembly import Placed


class PartOptions(Options):
    """One file, and where its robot is fixed."""

    file: str
    """Path of the URDF or MJCF in `files`."""
    root: str = ""
    """Link whose subtree is used; empty: the only one without a parent; `world`: everything in an MJCF."""
    prefix: str = ""
    """Begins the names of its links and joints."""
    on: str = ""
    """Link of an earlier part, with prefix, on which it is fixed; empty for the first part."""
    at_m: Vector = (0.0, 0.0, 0.0)
    """Origin of the root on that link [m]."""
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Rotation of the root on that link, w x y z."""
    drawn: tuple[str, ...] = ()
    """Meshes that touch and are seen too; where a link has geometry that is only seen, what touches is not drawn."""


class JointNumbers(Options):
    """What a file does not say about a joint, or says otherwise; a sliding joint has m and N."""

    lower_rad: float | None = None
    """Lower limit [rad]."""
    upper_rad: float | None = None
    """Upper limit [rad]."""
    velocity_rad_s: PositiveFloat | None = None
    """Maximum speed [rad/s]."""
    effort_nm: PositiveFloat | None = None
    """Maximum torque [N m]."""
    stiffness_nm_rad: NonNegativeFloat | None = None
    """Gain of the position actuator [N m/rad]."""
    damping_nms_rad: NonNegativeFloat | None = None
    """Damping of the position actuator [N m s/rad]."""


class ImportedRobotOptions(Options):
    """Options of simulate.imported_robot: the roles that files do not state."""

    name: str = "robot"
    """Name of the model."""
    source: str = "the project's files"
    """Source of kinematics, masses and limits."""
    parts: tuple[PartOptions, ...] = ()
    """Files, the arm's first."""
    hand: tuple[str, ...] = ()
    """Links at which the hand begins, with prefix; they and all links beyond are the hand, all others the arm."""
    active: tuple[str, ...] = ()
    """Joints that are driven, with prefix, `*` for any text; empty: all that move. Others are fixed at home."""
    frames: dict[str, FrameOptions] = Field(default_factory=dict)
    """Role -> frame on a link or a site: `flange`, `palm`, `tip_index`, ..."""
    home_rad: dict[str, float] = Field(default_factory=dict)
    """Joint -> home position [rad, m]; others are at the file's first keyframe, or at 0."""
    joints: dict[str, JointNumbers] = Field(default_factory=dict)
    """Joint -> numbers that count before those of the file."""
    velocity_rad_s: PositiveFloat | None = None
    """Maximum speed of joints whose file states none [rad/s]."""
    effort_nm: PositiveFloat | None = None
    """Maximum torque of joints whose file states none [N m]."""
    grips: dict[str, GripOptions] = Field(default_factory=dict)
    """Name -> grip of the hand."""
    apart: tuple[tuple[str, str], ...] = ()
    """Pairs of links excluded from contact, in addition to neighbours and to those that touch at home."""


@rule(version=1, packages=("mujoco",))
def imported_robot(ctx: Context, files: Folder, *, options: ImportedRobotOptions) -> RobotModel:
    """Return the robot of one file, or of an arm's and a hand's, with the roles that the options give.

    Names, kinematics, inertias, limits and meshes are those of the files; a mesh is searched by its relative path, and
    by `package://` anywhere in `files`. Joints that a file couples (`mimic`, `<equality><joint>`) follow their leaders.
    Position actuators take the file's gains, or 12 times the largest torque per radian.
    """
    from dextera_build.sim.model.imported import assembly
    from dextera_build.sim.render import portrait

    from .imported_roles import roles

    if not options.parts:
        here = listing(imported_parts.descriptions(files)) or "none"
        ctx.fail("no file is named", here=here, hint="`parts: [{file: robot.urdf}]`")
    place = ctx.scratch / "files"
    for path, data in files.files.items():
        (place / path).parent.mkdir(parents=True, exist_ok=True)
        (place / path).write_bytes(data)
    parts = [imported_parts.part(ctx, files, place, part, number) for number, part in enumerate(options.parts)]
    imported_parts.check_names(ctx, parts)
    sites, wanted = imported_parts.sites(parts), [imported_parts.Places(part) for part in parts]
    spec = assembly.attached(parts, options.name)
    found = roles(ctx, spec, parts, sites, options)
    folder, touching = assembly.finished(spec, found.plan)
    model = RobotModel(
        model=folder,
        joints=found.joints,
        links=found.links,
        frames={role: role for role in options.frames},
        source=options.source,
        grips=grips_of(ctx, options.grips, found.joints),
        followers=found.followers,
    )
    imported_parts.check_places(ctx, model, parts, wanted, found.plan.fixed)
    mass = sum(each.mass for each in wanted)
    ctx.metric("mass", mass, "kg")
    _tell(ctx, model, parts, found.plan.fixed, touching, mass)
    ctx.preview(portrait.of_robot(model.model, model.followed(model.home)), "at home")
    return model


def _tell(
    ctx: Context,
    model: RobotModel,
    parts: list[Placed],
    fixed: Mapping[str, float],
    touching: list[tuple[str, str]],
    mass: float,
) -> None:
    for part in parts:
        if part.source.dropped:
            ctx.warn(f"left out, because a robot model has none: {listing(part.source.dropped)}")
    if touching:
        pairs = listing(f"{one} and {other}" for one, other in touching)
        ctx.warn(f"these links touch at home, so they never do: {pairs}")
    hand = sum(joint.group == "hand" for joint in model.joints)
    more = [f"{len(model.followers)} followers"] if model.followers else []
    more += [f"{len(fixed)} fixed"] if fixed else []
    counts = ", ".join([f"{len(model.joints)} joints ({hand} of the hand)", *more, f"{len(model.links)} links"])
    ctx.say(f"{counts}, {mass:.1f} kg")
