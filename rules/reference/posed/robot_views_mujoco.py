"""Pictures of a robot with a board by MuJoCo's renderer."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.cameras.calibration import Board
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.world import World
from dextera_build.rule import Backend, Context, Options

from . import staged
from .robot_views import Posed

if TYPE_CHECKING:
    from .robot_views import RobotViewsOptions

BACKEND = Backend(
    summary="MuJoCo's OpenGL renderer (EGL, on the CPU or a GPU)",
    profiles=("cpu",),
    packages=("mujoco", "opencv-python-headless"),
    extra="twin",
)


def posed(
    ctx: Context,
    world: World,
    robot: RobotModel,
    board: Board,
    rows: np.ndarray | None,
    common: RobotViewsOptions,
    options: Options,
) -> Posed:
    """Photograph the postures of `rows`, or random ones around the world's until enough show board and hand."""
    stage = staged.stage(ctx, world, robot, board, common)
    chosen = staged.chosen(ctx, stage, world, robot, common) if rows is None else rows
    names = [joint.name for joint in robot.joints]
    postures = [dict(zip(names, row.tolist(), strict=True)) for row in chosen]
    return Posed(list(stage.shots(postures, common.supersample)), chosen)
