"""capture.robot_views: read a calibration capture, pictures of a robot in several poses, from a folder of files."""

from __future__ import annotations

from pathlib import PurePosixPath

from pydantic import Field

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.errors import listing
from dextera_build.rule import Context, rule

from ..facts import NAME, read
from ..taken import DepthOptions, Lenses, take
from . import agreement, moved, robot_states, target
from .moved import doubt_poses
from .seen import doubt_pictures


class RobotViewsOptions(DepthOptions):
    """Options of capture.robot_views."""

    effector_frame: str = ""
    """Link or frame of the robot's model whose pose is `T_base_ee`; empty: as `effector_frame` in the file."""
    names: dict[str, str] = Field(default_factory=dict)
    """Joint as in the file -> joint of `robot`, if the names differ."""


@rule(version=1, packages=("mujoco", "numpy", "pillow"))
def robot_views(
    ctx: Context, folder: Folder, robot: RobotModel | None = None, *, options: RobotViewsOptions
) -> RobotViews:
    """Return the pictures listed in `views` of `capture.json`, with the robot's poses and joint positions.

    `capture.json` contains the intrinsics and `depth_scale_m` as for `capture.folder`; `setup`, `eye-to-hand` or
    `eye-in-hand`; `target`, the board; and `views`, each with `rgb`, optionally `depth`, and `T_base_ee` (`t_m` [m]
    with `rotvec_rad` or `quat_wxyz`), or `joints` (name -> position [rad, m]), or both. `stamp_s` and `skew_s` [s] are
    optional. The pictures of one folder are of one camera.

    Joint positions are put in the order of `robot` and checked against it: names, limits, and the poses, if both are
    given.
    """
    if NAME not in folder.files:
        ctx.fail(f"`{NAME}` is missing in the capture", here=listing(folder.files), hint="`dxb new capture` writes one")
    facts = read(ctx, folder.files[NAME])
    mount = target.mount_of(ctx, facts)
    board = target.board_of(ctx, facts, mount)
    views = robot_states.views_of(ctx, facts, folder)
    effectors, joints = robot_states.effectors_of(ctx, views), robot_states.joints_of(ctx, views)
    if joints is not None and robot is None:
        agreement.doubt_units(ctx, joints)
    elif joints is not None and robot is not None:
        joints = agreement.in_model_order(ctx, joints, robot, options.names, timed=False)
    frame = options.effector_frame or str(facts.get("effector_frame") or "effector")
    if robot is not None and joints is not None and effectors is not None:
        moved.check_poses(ctx, robot, joints, effectors, frame)
    doubt_poses(
        ctx, effectors, None if joints is None else joints.positions, [f"views[{n}]" for n in range(len(views))]
    )
    lenses, captures, doubted = Lenses(ctx, folder, facts), {}, True
    for number, view in enumerate(views):
        names = (view.picture, view.depth)
        captures[_label(view.picture)] = take(ctx, folder, facts, lenses, names, options, doubted=doubted).capture
        doubted = doubted and view.depth is None  # all views have one camera: warnings about its depth are given once
        ctx.progress(number + 1, len(views), "pictures")
    if len(captures) < len(views):
        ctx.fail(
            f"`{NAME}`: pictures of different views have the same name",
            pictures=listing(view.picture for view in views),
            hint="give them different names",
        )
    doubt_pictures(ctx, {name: each.photograph.rgb.pixels for name, each in captures.items()})
    found = RobotViews(
        captures=captures,
        mount=mount,
        joints=joints,
        effectors=effectors,
        effector_frame=frame,
        board=board,
        skew_s=robot_states.skews_of(ctx, views),
    )
    ctx.preview(next(iter(captures.values())).photograph.rgb.pixels, "first picture")
    ctx.say(", ".join(found.facts()))
    return found


def _label(path: str) -> str:
    """`rgb_1` of `pictures/rgb_1.png`."""
    return PurePosixPath(path).stem
