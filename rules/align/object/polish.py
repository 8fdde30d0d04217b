"""Final steps of a registration: to the joint optimum of depth and outline."""

from __future__ import annotations

from itertools import islice

import numpy as np

from dextera_build.geometry import least_squares
from dextera_build.geometry.registration import ScaledPose

from . import spread
from .model_view import ModelView

STEPS = 6
"""Maximum number of steps."""
_SMALL = 0.02
"""Step size, in standard deviations, below which the iteration has converged."""
_WORSE = 0.02
"""Maximum increase of the render's cost per step; unlike the residuals, the cost includes smeared pixels."""


def polished(model: ModelView, placed: ScaledPose, scale_sigma: float, freedom: np.ndarray) -> ScaledPose:
    """Gauss-Newton steps on the residuals of the covariance; the unchanged placement if they do not improve it.

    Args:
        model: The model in front of the camera.
        placed: A placement near the end.
        scale_sigma: See `spread.covariance`.
        freedom: See `spread.covariance`.
    """

    def step(now: ScaledPose, _: int) -> tuple[np.ndarray, ScaledPose]:
        change, covariance = spread.step(model, now, scale_sigma, freedom)
        deviations = np.sqrt(np.maximum(np.diag(covariance), 1e-18))
        return change / (_SMALL * deviations + 1e-9), _moved(now, change)

    best = (model.score(placed).cost, placed)
    for now in islice(least_squares.gauss_newton(placed, step, range(STEPS), still=1.0), 1, None):
        cost = model.score(now).cost
        if cost < best[0] + _WORSE:
            best = (min(cost, best[0]), now)
    return best[1]


def _moved(placed: ScaledPose, step: np.ndarray) -> ScaledPose:
    return placed.moved(np.append(step[:6], np.clip(step[6], -0.1, 0.1)))
