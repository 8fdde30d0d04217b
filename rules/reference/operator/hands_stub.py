"""Fingertips that never move, without a model of the robot's hand."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(summary="straight fingers that never move", profiles=("stub",))


def tips(ctx: Context, robot: RobotModel, limb: str, positions: np.ndarray, options: Options) -> np.ndarray:
    """Tips (T, F, 3) [m] side by side in front of the palm."""
    count = len(robot.limbs[limb].tips)
    row = np.stack([np.full(count, 0.12), np.linspace(0.04, -0.04, count), np.full(count, -0.02)], axis=1)
    return np.repeat(row[None], len(positions), axis=0)
