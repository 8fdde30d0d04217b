"""Backend `stub` of align.hand_eye: a fixed pose, for tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.cameras.calibration import Board, Calibration
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import cameras
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .hand_eye import HandEyeOptions

BACKEND = Backend(summary="a camera before the robot that looks at it, for tests", profiles=("stub",))


def solve(
    ctx: Context,
    views: RobotViews,
    board: Board,
    robot: RobotModel | None,
    common: HandEyeOptions,
    options: Options,
) -> Calibration:
    """A camera at a fixed pose, with standard deviations of a millimetre and a milliradian."""
    holder = "base" if views.mount == "eye_on_base" else views.effector_frame
    matrix = cameras.look_at(np.array([1.2, 0.2, 0.6]), np.array([0.0, 0.0, 0.3]))
    return Calibration(
        mount=views.mount,
        pose=Pose(parent=holder, child="camera", matrix=matrix, covariance=1e-6 * np.eye(6)),
        effector_frame=views.effector_frame,
        camera=next(iter(views.captures.values())).photograph.camera,
        method="fixed",
        board=board,
        residuals=np.zeros((len(views.captures), 2)),
    )
