"""Fingertips that never move, without a model of the robot's hand."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import hands
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.retarget.correspondence import Correspondence

BACKEND = Backend(summary="straight fingers that never move", profiles=("stub",))


def beside(ctx: Context, robot: RobotModel, limb: str, lengths_m: np.ndarray, options: Options) -> Correspondence:
    """A palm that faces down, whose fingers are as long as the human's."""
    side = limb if limb in hands.SIDES else hands.SIDES[1]
    fingers = tuple(range(min(len(robot.limbs[limb].tips), len(hands.FINGERS))))
    turn = np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]])
    return Correspondence(side, robot.limbs[limb].tips[: len(fingers)], fingers, turn, np.array([0.03, 0.0, 0.0]), 1.0)


def tips(
    ctx: Context, robot: RobotModel, limb: str, own: Correspondence, positions: np.ndarray, options: Options
) -> np.ndarray:
    """Tips (T, F, 3) [m] side by side in front of the palm."""
    count = len(own.fingers)
    row = np.stack([np.full(count, 0.12), np.linspace(0.04, -0.04, count), np.full(count, -0.02)], axis=1)
    return np.repeat(row[None], len(positions), axis=0)
