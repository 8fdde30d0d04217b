"""Distinct postures without visibility checks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.cameras.calibration import Board
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.world import World
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .postures import PosturesOptions

BACKEND = Backend(summary="small turns of all joints about their home, unseen", profiles=("stub",))


def chosen(
    ctx: Context, world: World, robot: RobotModel, board: Board, common: PosturesOptions, options: Options
) -> np.ndarray:
    """Joint positions (K, J) [rad]."""
    home = np.array([joint.home for joint in robot.joints])
    return np.asarray(home + np.linspace(-0.1, 0.1, common.count)[:, None])
