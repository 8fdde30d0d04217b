"""A calibration by a board and one by the robot's surface, combined."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dextera_build.artifacts.cameras.calibration import Calibration
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import lie, uncertainty
from dextera_build.rule import Context


@dataclass(frozen=True)
class Combined:
    """The combined calibration."""

    pose: Pose  # T_camera_base with its covariance
    weight: float  # of the robot's surface, 0..1
    method: str


def combined(
    ctx: Context[Any],
    given: Calibration,
    camera_base: np.ndarray,
    spread: np.ndarray,
    cost: np.ndarray | None,
    least: float,
) -> Combined:
    """The pose of least mean squared error at the robot's points that both covariances guarantee.

    Both share the errors of the encoders, so their errors are correlated in an unknown way (covariance intersection).

    Args:
        ctx: Context.
        given: The calibration by the board; without a covariance it has no weight.
        camera_base: T_camera_base (4, 4) by the robot's surface.
        spread: Its covariance (6, 6).
        cost: (6, 6), see `Refinement.cost`; None: the given calibration has no weight.
        least: Probability of the difference below which the given calibration is kept.
    """
    from scipy.stats import chi2

    marked, name = given.pose.inverse(), given.method or "unstated"
    own = marked.model_copy(update={"matrix": camera_base, "covariance": spread})
    if cost is None or marked.covariance is None:
        return Combined(own, 1.0, f"{name}, balanced ICP")
    gap = lie.between(marked.matrix, own.matrix)
    chance = float(chi2.sf(gap @ np.linalg.solve(marked.covariance + spread, gap), 6))
    if chance < least:
        ctx.warn(
            f"the robot's surface contradicts the given calibration, which is kept: they differ by "
            f"{1000 * np.linalg.norm(gap[:3]):.1f} mm and {np.degrees(np.linalg.norm(gap[3:])):.2f} deg (chance "
            f"{chance:.1g}). Is the model that of this robot, and is its depth registered to the pictures?"
        )
        return Combined(marked, 0.0, name)
    weight, covariance = uncertainty.intersected(marked.covariance, spread, cost)
    step = weight * covariance @ np.linalg.solve(spread, gap)
    pose = marked.model_copy(update={"matrix": lie.retract(marked.matrix, step), "covariance": covariance})
    return Combined(pose, weight, f"{name}, balanced ICP" if weight else name)
