"""Objects at their start poses, without physics."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.scenes.world import Thing
from dextera_build.geometry import transforms
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(summary="things stand upright below the place from which they would fall", profiles=("stub",))


def let_fall(
    ctx: Context, things: dict[str, Thing], low: np.ndarray, high: np.ndarray, seconds: float, options: Options
) -> dict[str, np.ndarray]:
    """Upright poses on the table; objects may overlap."""
    return {
        name: transforms.rigid(np.eye(3), np.array([*thing.pose.matrix[:2, 3], 0.0])) for name, thing in things.items()
    }
