"""simulate.imported_robot: import a robot from URDF and MJCF files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.errors import listing
from dextera_build.rule import Context, rule

from . import imported_parts
from .imported_attach import hand_part
from .imported_options import ImportedRobotOptions
from .limbs import limbs_of
from .operated import with_hands

if TYPE_CHECKING:
    from dextera_build.sim.model.imported.assembly import Placed


@rule(version=4, packages=("mujoco",))
def imported_robot(ctx: Context, files: Folder, *, options: ImportedRobotOptions) -> RobotModel:
    """Return the robot of one file, or of an arm's and a hand's file, with the roles given in the options.

    Names, kinematics, inertias, limits and meshes are those of the files; a mesh is found by its relative path, and by
    `package://` anywhere in `files`. Joints that a file couples (`mimic`, `<equality><joint>`) follow their leaders.
    Position actuators have the file's gains, or 12 times the largest torque per radian. A geometry with its own
    friction is a skin, which determines the friction of its contacts with objects. Licences next to the files are
    copied into the model.
    """
    from dextera_build.sim.model.imported import assembly
    from dextera_build.sim.render import portrait

    from .imported_roles import roles

    if not options.parts:
        here = listing(imported_parts.descriptions(files)) or "none"
        ctx.fail("no file is named", here=here, hint="`parts: [{file: robot.urdf}]`")
    parts = [imported_parts.part(ctx, files, part, number) for number, part in enumerate(options.parts)]
    if options.attach is not None:
        options = _with_hand(ctx, options, parts)
        parts.append(imported_parts.part(ctx, files, options.parts[-1], len(parts)))
        if not options.hand:
            options = options.model_copy(update={"hand": (parts[-1].prefix + parts[-1].root,)})
    imported_parts.check_names(ctx, parts)
    sites, wanted = imported_parts.sites(parts), [imported_parts.Places(part) for part in parts]
    spec = assembly.attached(parts, options.name)
    found = roles(ctx, spec, parts, sites, options)
    folder, touching = assembly.finished(spec, found.plan)
    licences = imported_parts.licences(files, options.parts)
    model = RobotModel(
        model=Folder(files={**folder.files, **licences}),
        joints=found.joints,
        links=found.links,
        frames={role: role for role in options.frames},
        source=options.source,
        followers=found.followers,
    )
    model = with_hands(ctx, limbs_of(ctx, model, options.limbs, options.grips), options.hands)
    imported_parts.check_places(ctx, model, parts, wanted, found.plan.fixed)
    mass = sum(each.mass for each in wanted)
    ctx.metric("mass", mass, "kg")
    _tell(ctx, model, parts, found.plan.fixed, touching, mass)
    ctx.preview(portrait.of_robot(model.model, model.followed(model.home)), "at home")
    return model


def _with_hand(ctx: Context, options: ImportedRobotOptions, parts: list[Placed]) -> ImportedRobotOptions:
    """The options with the hand of `attach` as their last part."""
    links = [name for names in imported_parts.links(parts) for name in names]
    hand = hand_part(ctx, options, links, imported_parts.sites(parts))
    return options.model_copy(update={"parts": (*options.parts, hand)})


def _tell(
    ctx: Context,
    model: RobotModel,
    parts: list[Placed],
    fixed: Mapping[str, float],
    touching: list[tuple[str, str]],
    mass: float,
) -> None:
    for part in parts:
        for name, change in part.source.repaired.items():
            ctx.warn(f"link `{name}`: moments of inertia that no body has were repaired: {change}")
        for name, new in part.source.renamed.items():
            ctx.warn(f"link `{name}` is called `{new}`, because the root of a robot model is `{name}`")
        if part.source.dropped:
            ctx.warn(f"left out, because a robot model has none: {listing(part.source.dropped)}")
    if touching:
        pairs = listing(f"{one} and {other}" for one, other in touching)
        ctx.warn(f"links in contact at home: their mutual collisions are disabled: {pairs}")
    hand = sum(joint.group == "hand" for joint in model.joints)
    count = len(model.followers)
    more = [f"{count} follower{'s' if count > 1 else ''}"] if count else []
    more += [f"{len(fixed)} fixed"] if fixed else []
    counts = ", ".join([f"{len(model.joints)} joints ({hand} of the hand)", *more, f"{len(model.links)} links"])
    ctx.say(f"{counts}, {mass:.1f} kg")
