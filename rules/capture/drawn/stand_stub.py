"""The first place is taken, whatever the robot hides."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.robot import RobotModel
from dextera_build.artifacts.world import RobotStand, World
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(summary="the first free place, unseen", profiles=("stub",))


class Anywhere:
    """Every place is good."""

    def sight(self, stand: RobotStand) -> tuple[np.ndarray, float, float]:
        """Nothing hidden, robot and hand seen."""
        return np.zeros(1), 1.0, 1.0

    def points(self, stand: RobotStand) -> np.ndarray:
        """One place high above."""
        return np.array([[0.0, 0.0, 10.0]])


def trial(ctx: Context, world: World, robot: RobotModel, options: Options) -> Anywhere:
    """See `Anywhere`."""
    return Anywhere()
