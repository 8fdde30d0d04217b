"""Reward values of the stages common to all primitives.

The value is a pure function of an episode's progress. The reward is the change of the value from step to step, so the
sum over an episode depends only on its final state: hovering before the goal, going back and forth, or throwing an
object gains nothing, because a stage counts only while the one before it holds.
"""

from __future__ import annotations

import numpy as np

from dextera_build.sim.primitives.state import GraspState

NEAR_M = 0.2
"""Distance at which the value of reaching is 0 [m]; linear, for a gradient from far away."""
FAR_M = 0.8
"""Distance beyond which the value is constant [m]."""
REACH, HOLD, MOVE, DONE = 1.0, 1.0, 4.0, 5.0
"""Values of the stages: at the object, in the hand, moved to the goal, held there until success."""


def near(distance_m: np.ndarray) -> np.ndarray:
    """1 at distance 0, 0 at `NEAR_M`, negative up to `FAR_M`, for distances (N,).

    It is capped there, because one object knocked far off the table would outweigh a hundred episodes.
    """
    return np.asarray(1.0 - np.fmin(distance_m, FAR_M) / NEAR_M)


def holding(grasp: GraspState) -> np.ndarray:
    """Progress of a grasp (N,) from 0 to 1: up to two fingers press, and they oppose each other."""
    return np.asarray(0.25 * np.minimum(grasp.fingers, 2) + 0.5 * grasp.opposing)


def clamp(value: np.ndarray, low: float, high: float) -> np.ndarray:
    """Numbers (N,) clipped to limits, NaN unchanged; `np.clip` takes several times as long for a few."""
    return np.asarray(np.minimum(np.maximum(value, low), high))
