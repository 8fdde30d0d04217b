"""The first pose is accepted, without visibility checks."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.world import RobotStand, World
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(summary="the first free place, unseen", profiles=("stub",))


def points(
    ctx: Context, world: World, robot: RobotModel, stands: list[RobotStand], options: Options
) -> list[np.ndarray]:
    """High above everything."""
    return [np.array([[0.0, 0.0, 10.0]]) for _ in stands]


def sights(
    ctx: Context, world: World, robot: RobotModel, stands: list[RobotStand], options: Options
) -> Iterator[tuple[np.ndarray, float, float]]:
    """Nothing hidden, robot and hand visible."""
    return ((np.zeros(1), 1.0, 1.0) for _ in stands)
