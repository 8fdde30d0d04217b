"""Final steps of a registration: to the joint optimum of depth and outline."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dextera_build.geometry import registration, transforms
from dextera_build.geometry.registration import Similarity

from . import spread
from .model_view import ModelView

STEPS = 6
"""Maximum number of steps."""
_SMALL = 0.02
"""Step size, in standard deviations, below which the iteration has converged."""
_WORSE = 0.02
"""Maximum increase of the render's cost per step; unlike the residuals, the cost includes smeared pixels."""


def polished(model: ModelView, placed: Similarity, scale_sigma: float, freedom: np.ndarray) -> Similarity:
    """Gauss-Newton steps on the residuals of the covariance; the unchanged placement if they do not improve it.

    Args:
        model: The model in front of the camera.
        placed: A placement near the end.
        scale_sigma: See `spread.covariance`.
        freedom: See `spread.covariance`.
    """
    now, best = placed, (model.score(placed).cost, placed)
    for _ in range(STEPS):
        step, covariance = spread.step(model, now, scale_sigma, freedom)
        now = _moved(now, step)
        cost = model.score(now).cost
        if cost < best[0] + _WORSE:
            best = (min(cost, best[0]), now)
        deviations = np.sqrt(np.maximum(np.diag(covariance), 1e-18))
        if np.all(np.abs(step) < _SMALL * deviations + 1e-9):
            break
    return best[1]


def _moved(placed: Similarity, step: np.ndarray) -> Similarity:
    """The placement changed by a translation, a rotation vector and a log scale about its origin."""
    limited = np.clip(step[6], -0.1, 0.1)
    turn = registration.rotation(step[3:6]) @ placed.pose[:3, :3]
    pose = transforms.rigid(turn, placed.pose[:3, 3] + step[:3])
    return replace(placed, scale=placed.scale * float(np.exp(limited)), pose=pose)
