"""Option `attach` of simulate.imported_robot: the hand's file as a second part on a frame of the arm."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.errors import did_you_mean, listing
from dextera_build.rule import Context

from .imported_options import ImportedRobotOptions, PartOptions

if TYPE_CHECKING:
    from dextera_build.sim.model.imported.assembly import Frame


def hand_part(ctx: Context, options: ImportedRobotOptions, links: list[str], sites: Mapping[str, Frame]) -> PartOptions:
    """The hand of `attach`, as a part of the robot.

    Args:
        ctx: Context for errors.
        options: Options of the rule, with `attach`.
        links: Links of the parts so far, the root as `base`.
        sites: Name of a site of these parts -> its frame.
    """
    from dextera_build.geometry import poses

    attach = options.attach
    assert attach is not None
    role = options.frames.get(attach.at)
    name = attach.at if role is None else role.link
    if name not in links and name not in sites:
        known = [*options.frames, *links, *sites]
        ctx.fail(
            f"`attach` names `{attach.at}`, but no frame, link or site of the arm is called so",
            frames=listing(options.frames) or "none",
            links=listing(links, most=60),
            sites=listing(sites, most=40) or "none",
            hint=did_you_mean(attach.at, known) or "`at: LINK`, the last link of the arm",
        )
    pose = np.eye(4)
    link = name
    if name not in links:
        link = sites[name].link
        pose = poses.to_matrix(np.array([*sites[name].place, *sites[name].turn]))
    for each in (role, attach):
        if each is not None:
            turn = np.array(each.quaternion) / np.linalg.norm(each.quaternion)
            pose = pose @ poses.to_matrix(np.array([*each.at_m, *turn]))
    at = poses.from_matrix(pose)
    return PartOptions(
        file=attach.hand,
        prefix=attach.prefix,
        on=link,
        at_m=tuple(at[:3].tolist()),
        quaternion=tuple(at[3:].tolist()),
        repair_inertias=attach.repair_inertias,
        solid=attach.solid,
    )
