"""Pictures by ray casting, without robot and board: fast, and without a GL context."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.cameras.calibration import Board
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.world import World
from dextera_build.rule import Backend, Context, Options

from ..unlit import unlit
from .robot_views import Posed

if TYPE_CHECKING:
    from .robot_views import RobotViewsOptions

BACKEND = Backend(summary="ray casting, no lights, no robot", profiles=("stub",), packages=("open3d",), extra="twin")


def posed(
    ctx: Context,
    world: World,
    robot: RobotModel,
    board: Board,
    rows: np.ndarray | None,
    common: RobotViewsOptions,
    options: Options,
) -> Posed:
    """The same picture for every posture, with distinct joint positions."""
    shot, home = unlit(world), np.array([joint.home for joint in robot.joints])
    if rows is None:
        rows = home + np.linspace(-0.1, 0.1, common.count)[:, None] * np.ones(len(home))
    return Posed([shot] * len(rows), rows)
