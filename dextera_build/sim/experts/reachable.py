"""How far palm poses are from those that an arm reaches with ease, to order many candidates quickly."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from dextera_build.sim.control.ik import ArmKinematics

SAMPLES = 6_000
"""Number of drawn arm postures."""
SPREAD_RAD = 0.7
"""Standard deviation of the postures around home [rad]."""
MARGIN_RAD = 0.15
"""Distance of drawn joints to their limits [rad]."""
TURN_M = 0.12
"""Distance that counts as a unit change of one of the palm's axes, 57 deg [m]."""


class Reachable:
    """Palm poses of drawn arm postures of one limb.

    Args:
        arm: Kinematics of the limb.
    """

    def __init__(self, arm: ArmKinematics) -> None:
        drawn = np.random.default_rng(0).normal(arm.home, SPREAD_RAD, (SAMPLES, len(arm.home)))
        inside = np.clip(drawn, arm.lower + MARGIN_RAD, arm.upper - MARGIN_RAD)
        self._tree = cKDTree(_features(np.array([arm.pose(joints) for joints in inside])))

    def away_m(self, palms: np.ndarray) -> np.ndarray:
        """Distances (N,) of palm poses (N, 4, 4) in the base to the nearest drawn one [m, see `TURN_M`]."""
        return np.asarray(self._tree.query(_features(palms))[0])


def _features(palms: np.ndarray) -> np.ndarray:
    """Position and two axes (N, 9) of poses (N, 4, 4) [m]."""
    return np.concatenate([palms[:, :3, 3], TURN_M * palms[:, :3, 0], TURN_M * palms[:, :3, 2]], axis=1)
