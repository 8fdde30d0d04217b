"""capture.robot_views: read a calibration capture, pictures of a robot in several poses, from a folder of files."""

from __future__ import annotations

from pathlib import PurePosixPath

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robot_views import RobotViews
from dextera_build.errors import listing
from dextera_build.geometry import poses, transforms
from dextera_build.rule import Context, rule

from ..facts import NAME, read
from ..taken import DepthOptions, Lenses, take
from . import stood, target

STILL_M, STILL_RAD = 1e-3, 2e-3
"""Poses of an effector that has not moved."""


class RobotViewsOptions(DepthOptions):
    """Options of capture.robot_views."""

    effector_frame: str = ""
    """Link or frame of the robot's model that `T_base_ee` is the pose of; empty: as `effector_frame` in the file."""


@rule(version=1, packages=("numpy", "pillow"))
def robot_views(ctx: Context, folder: Folder, *, options: RobotViewsOptions) -> RobotViews:
    """Return the pictures that `views` in `capture.json` names, with the robot's poses and joint positions.

    `capture.json` contains the intrinsics and `depth_scale_m` as for `capture.folder`; `setup`, `eye-to-hand` or
    `eye-in-hand`; `target`, the board; and `views`, each with `rgb`, `depth` if there is some, and `T_base_ee`
    (`t_m` [m] with `rotvec_rad` or `quat_wxyz`), or `joints` (name -> position [rad, m]), or both. `stamp_s` and
    `skew_s` [s] are optional. The pictures of one folder are of one camera.
    """
    if NAME not in folder.files:
        ctx.fail(f"`{NAME}` is missing in the capture", here=listing(folder.files), hint="`dxb new capture` writes one")
    facts = read(ctx, folder.files[NAME])
    mount = target.mount_of(ctx, facts)
    board = target.board_of(ctx, facts, mount)
    views = stood.views_of(ctx, facts, folder)
    effectors, joints = stood.effectors_of(ctx, views), stood.joints_of(ctx, views)
    _doubt_poses(ctx, effectors, None if joints is None else joints.positions)
    lenses, captures, doubted = Lenses(ctx, folder, facts), {}, True
    for number, view in enumerate(views):
        names = (view.picture, view.depth)
        captures[_label(view.picture)] = take(ctx, folder, facts, lenses, names, options, doubted=doubted).capture
        doubted = doubted and view.depth is None  # one camera: what is wrong with its depth is said once
        ctx.progress(number + 1, len(views), "pictures")
    if len(captures) < len(views):
        ctx.fail(
            f"`{NAME}`: pictures of different views have the same name",
            pictures=listing(view.picture for view in views),
            hint="give them different names",
        )
    found = RobotViews(
        captures=captures,
        mount=mount,
        joints=joints,
        effectors=effectors,
        effector_frame=options.effector_frame or str(facts.get("effector_frame") or "effector"),
        board=board,
        skew_s=stood.skews_of(ctx, views),
    )
    ctx.preview(next(iter(captures.values())).photograph.rgb.pixels, "first picture")
    ctx.say(", ".join(found.facts()))
    return found


def _label(path: str) -> str:
    """`rgb_1` of `pictures/rgb_1.png`."""
    return PurePosixPath(path).stem


def _doubt_poses(ctx: Context, effectors: np.ndarray | None, joints: np.ndarray | None) -> None:
    """Warn of captures that determine nothing: one pose, or a robot that did not move."""
    rows = effectors if effectors is not None else joints
    assert rows is not None
    if len(rows) == 1:
        ctx.warn("there is one pose only: a hand-eye calibration needs at least 3, turned about different axes")
        return
    same = [number for number in range(1, len(rows)) if _same(rows[number - 1], rows[number], effectors is not None)]
    if same:
        ctx.warn(
            f"the robot stands as in the view before in {listing(f'views[{number}]' for number in same)}: was its pose "
            "recorded anew for each picture?"
        )


def _same(before: np.ndarray, now: np.ndarray, placed: bool) -> bool:
    if not placed:
        return bool(np.abs(now - before).max() < STILL_M)
    moved = transforms.invert(poses.to_matrix(before)) @ poses.to_matrix(now)
    return bool(np.linalg.norm(moved[:3, 3]) < STILL_M and transforms.angle(moved[:3, :3]) < STILL_RAD)
