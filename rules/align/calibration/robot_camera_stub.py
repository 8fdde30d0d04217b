"""Backend `stub` of align.robot_camera: returns the calibration unchanged, for tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.rule import Backend, Context, Options

from .robot_camera import Refinement

if TYPE_CHECKING:
    from .robot_camera import RobotCameraOptions

BACKEND = Backend(summary="returns the calibration unchanged, for tests", profiles=("stub",))


def refine(
    ctx: Context,
    views: RobotViews,
    robot: RobotModel,
    camera_base: np.ndarray,
    common: RobotCameraOptions,
    options: Options,
) -> Refinement:
    """The first estimate, with standard deviations of a millimetre and a milliradian."""
    count = len(views.captures)
    return Refinement(
        camera_base, 1e-6 * np.eye(6), {"arm": np.zeros(count), "hand": np.zeros(count)}, np.ones(count), 0.0
    )
