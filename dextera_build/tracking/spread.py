"""Propagation of the errors of all terms to a fitted pose.

The covariance is that of a weighted least squares estimate with correlated residuals (the sandwich H^-1 S H^-1 of Huber
1967 and White 1980, with clusters as Liang and Zeger 1986). S is the sum of the noise of every frame, errors common to
a patch of the surface, such as those of the mesh, the mean residuals of each patch, and the error of the stored view
that brightness is compared with. Averaging the poses of a static object reduces only the first.

The deviations of the terms were chosen so that the 95 % regions contain 92 to 98 % of the true poses of rendered
sequences; `tests/benchmarks/tracking/coverage.py` measures the coverage on others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.tracking.terms import Rows

UNKNOWN = np.array([1.0, 1.0, 1.0, 1.8, 1.8, 1.8])
"""Stated standard deviation of a motion that no term determines [m, rad]; 1.8 rad is a uniform rotation."""
_LEAST = 0.02
"""Lower bound of the stated error, as a fraction of that of independent residuals."""


@dataclass(frozen=True)
class Spread:
    """Errors of a fit, as matrices (6 + J, 6 + J) over a twist and the joints."""

    information: np.ndarray
    """Information of all terms, H."""
    noise: np.ndarray
    """Covariance of H times the error, of noise that is independent between frames."""
    lasting: np.ndarray
    """The same for persistent errors."""

    def covariance(self, frames: int = 1) -> np.ndarray:
        """Covariance (6 + J, 6 + J) of the mean of the poses of so many frames [m, rad]."""
        inner = self.noise / frames + self.lasting + _LEAST * self.information / frames
        size = len(inner)
        scale = np.sqrt(np.diag(inner).clip(1e-9))
        inner = inner / np.outer(scale, scale) + 1e-9 * np.eye(size)
        told = self.information / scale[:, None]
        free = np.append(UNKNOWN, np.full(size - 6, UNKNOWN[5]))
        return np.asarray(np.linalg.inv(told.T @ np.linalg.solve(inner, told) + np.diag(free**-2.0)))


def of(rows: Sequence[Rows], earlier: np.ndarray | None) -> Spread:
    """Errors of an estimate from the rows of its last step.

    Args:
        rows: Rows of each term.
        earlier: (6, 6) covariance of the pose of the stored view that the last term compares brightness with, or None.
    """
    size = rows[0].jacobian.shape[1]
    information, noise, lasting = (np.zeros((size, size)) for _ in range(3))
    for each in rows:
        pull = each.jacobian * each.weight[:, None]
        told = pull.T @ each.jacobian
        information += told
        noisy = pull * each.noise[:, None]
        noise += noisy.T @ noisy
        patches, number = np.unique(each.patch, return_inverse=True)
        for common in (*each.lasting.T, each.off):
            summed = np.zeros((len(patches), size))
            np.add.at(summed, number, pull * common[:, None])
            lasting += summed.T @ summed
    if earlier is not None:
        # `told` is that of brightness, the last term, which repeats an error of the earlier pose.
        lasting += told[:, :6] @ earlier @ told[:6]
    return Spread(information, noise, lasting)
