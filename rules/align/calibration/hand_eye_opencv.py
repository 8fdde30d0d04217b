"""Backend `opencv` of align.hand_eye: OpenCV's board detectors and a joint refinement."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from dextera_build.artifacts.cameras.calibration import Board, Calibration
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.geometry import hand_eye as problem
from dextera_build.rule import Backend, Context, Options

from . import detection, overlays, solving, stated

if TYPE_CHECKING:
    from .hand_eye import HandEyeOptions

BACKEND = Backend(
    summary="OpenCV's detectors of ArUco, ChArUco, AprilTag and chessboards; joint refinement",
    profiles=("cpu",),
    packages=("opencv-python-headless", "mujoco"),
    extra="twin",
)


class OpencvOptions(Options):
    """Options of backend `opencv` of align.hand_eye."""

    refinement: Literal["edges", "subpixel"] = "edges"
    """Corners of markers from the intersection of their edges, or from OpenCV's `cornerSubPix`."""


def solve(
    ctx: Context,
    views: RobotViews,
    board: Board,
    robot: RobotModel | None,
    common: HandEyeOptions,
    options: OpencvOptions,
) -> Calibration:
    """The calibration from all pictures in which the board is found and consistent with the robot."""
    from dextera_build.sim.model import forward

    frame = common.effector_frame or views.effector_frame
    effectors = stated.effectors(ctx, views, robot, frame, forward.frames)
    seen = {}
    for number, (name, capture) in enumerate(views.captures.items()):
        photograph = capture.photograph
        try:
            seen[name] = detection.look(photograph.rgb.pixels, photograph.camera.matrix(), board, options.refinement)
        except ValueError as error:
            ctx.fail(str(error), hint="OpenCV's are `DICT_4X4_50` to `DICT_7X7_1000`, and `36h11` of AprilTag")
        ctx.progress(number + 1, len(views.captures), "pictures")
    camera = next(iter(views.captures.values())).photograph.camera
    setup = problem.Setup(camera.matrix(), views.mount == "eye_in_hand")
    solved = solving.solve(ctx, setup, dict(zip(views.captures, effectors, strict=True)), seen, common)
    found = solving.calibration(solved, setup, frame, camera, board)
    if robot is not None and views.joints is not None:
        part = stated.frame_of(robot, frame)
        drifts = forward.drifts(robot, views.joints.names, views.joints.positions, part)
        sigma = float(np.radians(common.joint_sigma_deg))
        found = solving.with_joints(found, solved, setup, dict(zip(views.captures, drifts, strict=True)), sigma)
    overlays.preview(ctx, views, solved, setup, found)
    return found
