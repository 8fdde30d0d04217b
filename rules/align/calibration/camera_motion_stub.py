"""Backend `stub` of align.camera_motion: the board has not moved, for tests."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.cameras.calibration import Calibration
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(summary="the board is where it was, for tests", profiles=("stub",))


def poses(
    ctx: Context,
    views: RobotViews,
    robot: RobotModel | None,
    calibration: Calibration,
    frame: str,
    options: Options,
) -> tuple[np.ndarray, np.ndarray]:
    """The same expected and measured pose for every picture."""
    still = np.tile(np.eye(4), (len(views.captures), 1, 1))
    return still, still
