"""simulate.settle without a simulator: every body rests."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.scenes.scene import Scene, Settled, SettleReport
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .settle import SettleOptions

BACKEND = Backend(summary="no simulation: everything rests", profiles=("stub",))


def let_go(ctx: Context, scene: Scene, common: SettleOptions, options: Options) -> SettleReport:
    """Return a report without motion."""
    bodies = tuple(
        Settled(name=name, drift_m=0.0, tilt_rad=0.0, penetration_m=0.0, resting=True) for name in scene.bodies
    )
    return SettleReport(bodies=bodies, seconds=common.seconds, energy_j=np.zeros(2), passed=True)
