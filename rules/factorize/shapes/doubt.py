"""Uncertainty of a fit: covariance of pose, size and volume over the parameters of the best family, and its rival."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .evidence import Evidence
from .hypotheses import Finished
from .refine import INDEPENDENT, Model, curvature

GUESSED = 0.3
"""Relative standard deviation of a size that the view does not determine: the range of the tried values."""
UNKNOWN_STEPS = 30.0
"""Standard deviation of a parameter that the view does not determine, in its finite-difference steps."""


@dataclass(frozen=True)
class Doubt:
    """First-order uncertainty of a fitted body."""

    pose: np.ndarray  # (6, 6) covariance of translation [m] and rotation vector [rad], axes of the world
    size_sigma: float  # standard deviation of the log of its size, at a fixed shape
    volume_sigma: float  # standard deviation of its log volume


def of_fit(
    model: Model, evidence: Evidence, found: np.ndarray, finish: Callable[[np.ndarray], Finished], loose: list[int]
) -> Doubt:
    """Propagate the fit's covariance to pose, size and volume.

    All residuals together have the weight of `INDEPENDENT` measurements, independent of the number of pixels. If they
    exceed their standard deviations, the covariance is scaled up.

    Args:
        model: The family.
        evidence: The view.
        found: Its fitted parameters (P,).
        finish: Makes the body from parameters.
        loose: Parameters that `undetermined` returned: much larger or smaller values fit as well.
    """
    normal, loss = curvature(model, evidence, found)
    # A loss of one for each is expected at the stated standard deviations.
    worse = max(loss / 2.0, 1.0)
    steps = np.linalg.inv(INDEPENDENT / worse * normal + np.eye(len(found)) / UNKNOWN_STEPS**2)
    for i in loose:
        # Flat direction: the curvature at the optimum does not show that distant values fit as well.
        steps[i, i] += (GUESSED * found[i] / model.steps[i]) ** 2
    centre = finish(found)
    slopes = np.zeros((8, len(found)))
    for i, step in enumerate(model.steps):
        sign = 1.0 if found[i] + step <= model.upper[i] else -1.0
        there = found.copy()
        there[i] += sign * step
        slopes[:, i] = sign * _change(centre, finish(there))
    total = slopes @ steps @ slopes.T
    return Doubt(total[:6, :6], float(np.sqrt(total[6, 6])), float(np.sqrt(total[7, 7])))


def _change(first: Finished, second: Finished) -> np.ndarray:
    """Translation [m], rotation vector [rad], log size and log volume from one body to another, (8,)."""
    turn = second.pose[:3, :3] @ first.pose[:3, :3].T
    vector = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2.0
    sizes = [float(np.linalg.norm(np.ptp(body.solid.vertices, axis=0))) for body in (first, second)]
    volumes = [max(body.solid.volume, 1e-12) for body in (first, second)]
    return np.array(
        [*(second.pose - first.pose)[:3, 3], *vector, np.log(sizes[1] / sizes[0]), np.log(volumes[1] / volumes[0])]
    )
