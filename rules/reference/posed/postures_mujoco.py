"""Postures with board and hand visible in MuJoCo's renderer."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.cameras.calibration import Board
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.world import World
from dextera_build.rule import Backend, Context, Options

from . import staged

if TYPE_CHECKING:
    from .postures import PosturesOptions

BACKEND = Backend(
    summary="MuJoCo's OpenGL renderer (EGL, on the CPU or a GPU)",
    profiles=("cpu",),
    packages=("mujoco", "opencv-python-headless"),
    extra="twin",
)


def chosen(
    ctx: Context, world: World, robot: RobotModel, board: Board, common: PosturesOptions, options: Options
) -> np.ndarray:
    """Joint positions (K, J) [rad] around the world's in which board and hand are visible."""
    return staged.chosen(ctx, staged.stage(ctx, world, robot, board, common), world, robot, common)
