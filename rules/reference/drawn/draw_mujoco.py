"""Falling objects in MuJoCo."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.scenes.world import Thing
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.worlds import falling

BACKEND = Backend(
    summary="MuJoCo's rigid bodies, from above the table until they rest",
    profiles=("cpu",),
    packages=("mujoco", "scipy"),
    extra="twin",
)


def let_fall(
    ctx: Context, things: dict[str, Thing], low: np.ndarray, high: np.ndarray, seconds: float, options: Options
) -> dict[str, np.ndarray]:
    """Simulate until all objects rest; see `falling.let_fall`."""
    return falling.let_fall(things, low, high, seconds)
