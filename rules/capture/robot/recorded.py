"""Views of a robot from a recording: pictures and joint positions at moments of rest."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from dextera_build.artifacts.cameras.calibration import Board
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.artifacts.robots.stream import Stream
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.formats import mcap
from dextera_build.geometry import synchronisation
from dextera_build.rule import Context, Options

from ..taken import DepthOptions
from . import agreement, clock, frames, moved, topics
from .seen import doubt_pictures


class BoardOptions(Options):
    """A calibration board, as `artifacts.calibration.Board`."""

    kind: Literal["chessboard", "charuco", "aruco", "apriltag", "circles", "asymmetric_circles"]
    """Pattern."""
    columns: PositiveInt = 1
    """Inner corners of a chessboard, squares of a ChArUco board, markers, or circles of one row, along x."""
    rows: PositiveInt = 1
    """The same along y."""
    square_m: PositiveFloat
    """Side of a square, of a single marker, or of a marker and one gap; distance of circles, see `Board` [m]."""
    marker_m: NonNegativeFloat = 0.0
    """Side of a marker if it differs from `square_m` [m]."""
    dictionary: str = ""
    """Family of the markers."""


class TopicOptions(Options):
    """Topics of one camera in a recording; an empty topic is the only one of its type."""

    image: str = ""
    """Topic of the pictures."""
    depth: str = ""
    """Topic of depth that is registered to the pictures, or of a RealSense recording with extrinsics; empty: none."""
    camera_info: str = ""
    """Topic of the intrinsics; empty: the one next to the pictures' topic."""
    mount: Literal["eye_on_base", "eye_in_hand"] = "eye_on_base"
    """`eye_on_base`: the camera is mounted next to the robot; `eye_in_hand`: on the hand."""
    board: BoardOptions | None = None
    """The board on the effector, or in front of a camera on the effector."""


class RecordedOptions(DepthOptions):
    """Options of rules that extract views from recordings."""

    joints: str = ""
    """Topic of the joint states; empty: the only one."""
    poses: str = ""
    """Topic of the effector's poses in the base frame; empty: none, they are computed with the model."""
    effector_frame: str = "effector"
    """Link or frame of the robot's model whose poses `poses` are."""
    names: dict[str, str] = Field(default_factory=dict)
    """Joint as recorded -> joint of the model, if the names differ."""
    still_rad_s: PositiveFloat = 0.01
    """Largest joint speed at rest [rad/s, of a prismatic joint m/s]."""
    rest_s: PositiveFloat = 0.4
    """Shorter rests are left out [s]."""
    apart_rad: PositiveFloat = 0.02
    """Smallest difference in at least one joint between two views [rad, of a prismatic joint m]."""
    most: PositiveInt = 40
    """Maximum number of views, evenly distributed over the recording."""
    skew_s: PositiveFloat = 0.05
    """Largest time from a picture to the nearest joint measurement [s]."""
    reach_s: PositiveFloat = 1.0
    """Largest offset of the clocks that is searched [s]."""
    clock_offset_s: float | None = None
    """Time of the joints minus time of the pictures at the same moment; None: estimated from motion [s]."""


class Moments(NamedTuple):
    """Pictures taken while the robot was at rest."""

    stamps: np.ndarray  # (K,) of the pictures [s]
    times: np.ndarray  # (K,) the same on the clock of the joints [s]
    positions: np.ndarray  # (K, J) [rad or m]
    skews: np.ndarray  # (K,) [s]


def views(
    ctx: Context,
    stream: Stream,
    states: Stream,
    robot: RobotModel | None,
    where: TopicOptions,
    options: RecordedOptions,
    label: str = "view",
) -> RobotViews:
    """The views of one camera.

    Args:
        ctx: Context for errors and warnings.
        stream: Recording of the camera.
        states: Recording of the robot, often the same.
        robot: The model that the joint states are checked against.
        where: The camera's topics.
        options: Selection of the moments.
        label: Prefix of the names of the views.
    """
    seen = topics.of_camera(ctx, stream, where.image, where.depth, where.camera_info)
    joints = _in_order(mcap.joints(states, topics.of_joints(ctx, states, options.joints)))
    if robot is None:
        agreement.doubt_units(ctx, joints)
    else:
        joints = agreement.in_model_order(ctx, joints, robot, options.names)
    stamps = mcap.stamps(stream, seen.image)[:, 0]
    offset = clock.offset(ctx, stream, seen.image, joints, options.clock_offset_s, options.reach_s)
    clock.check_overlap(ctx, stamps + offset, joints.stamps)
    moments = _moments(ctx, np.sort(stamps), joints, offset, options)
    effectors = None
    if options.poses:
        path = mcap.poses(states, options.poses, options.effector_frame)
        effectors = clock.poses_at(ctx, path.stamps, path.poses, moments.times, options.skew_s)
        if robot is not None:
            chosen = joints.model_copy(
                update={"stamps": moments.times, "positions": moments.positions, "velocities": None}
            )
            moved.check_poses(ctx, robot, chosen, effectors, options.effector_frame)
    captures = frames.at(ctx, stream, seen, moments.stamps, options, label)
    doubt_pictures(ctx, {name: each.photograph.rgb.pixels for name, each in captures.items()})
    moved.doubt_poses(ctx, None, moments.positions, list(captures))
    ctx.preview(next(iter(captures.values())).photograph.rgb.pixels, f"first {label}")
    return RobotViews(
        captures=captures,
        mount=where.mount,
        joints=Joints(names=joints.names, stamps=moments.times, positions=moments.positions),
        effectors=effectors,
        effector_frame=options.effector_frame,
        board=None if where.board is None else Board(**where.board.model_dump()),
        skew_s=moments.skews,
    )


def _in_order(joints: Joints) -> Joints:
    """Joint states sorted by stamp without duplicates; drivers repeat and swap messages."""
    _, rows = np.unique(joints.stamps, return_index=True)
    return Joints(names=joints.names, stamps=joints.stamps[rows], positions=joints.positions[rows])


def _moments(ctx: Context, stamps: np.ndarray, joints: Joints, offset: float, options: RecordedOptions) -> Moments:
    """One picture per rest, in distinct postures."""
    still = synchronisation.rests(joints.stamps, joints.positions, options.still_rad_s, options.rest_s)
    if not still:
        ctx.fail(
            f"the robot never rests for {options.rest_s:g} s",
            recorded=f"{joints.stamps[0]:.3f} to {joints.stamps[-1]:.3f} s",
            hint="stop for a second in each pose, or set `still_rad_s` and `rest_s`",
        )
    chosen: list[float] = []
    for start, end in still:
        inside = stamps[(stamps + offset >= start) & (stamps + offset <= end)]
        if len(inside):
            late = synchronisation.nearest_gap(inside + offset, joints.stamps) > options.skew_s
            far = np.abs(inside - ((start + end) / 2 - offset))
            chosen.append(float(inside[np.lexsort((far, late))[0]]))
    if not chosen:
        ctx.fail(
            "no picture was taken while the robot rested",
            rests=f"{len(still)}",
            pictures=f"{len(stamps)}",
            hint="take pictures while the robot stands still",
        )
    times = np.array(chosen) + offset
    skews = synchronisation.nearest_gap(times, joints.stamps)
    late = skews > options.skew_s
    if late.all():
        ctx.fail(
            "no picture has a joint measurement near its time",
            nearest=f"{1000 * skews.min():.0f} ms",
            allowed=f"{1000 * options.skew_s:.0f} ms",
            hint="record joint states at 50 Hz and more, or set `skew_s`",
        )
    if late.any():
        ctx.warn(f"{late.sum()} of {len(late)} rests are left out: their joints were measured more than the skew apart")
    kept = np.flatnonzero(~late)
    positions = joints.at(times[kept])
    distinct = _distinct(positions, options.apart_rad)
    if len(distinct) > options.most:
        distinct = [distinct[row] for row in np.linspace(0, len(distinct) - 1, options.most).round().astype(int)]
    rows = kept[distinct]
    return Moments(np.array(chosen)[rows], times[rows], positions[distinct], skews[rows])


def _distinct(positions: np.ndarray, apart: float) -> list[int]:
    """Rows that differ from all rows before them."""
    found: list[int] = []
    for row, posture in enumerate(positions):
        if all(np.abs(posture - positions[other]).max() > apart for other in found):
            found.append(row)
    return found
