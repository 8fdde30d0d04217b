"""What the errors of all terms do to a fitted pose.

The covariance is that of a weighted least squares estimate whose residuals are not as independent as its weights say
(the sandwich H^-1 S H^-1 of Huber 1967 and White 1980, with clusters as Liang and Zeger 1986). S adds up the noise of
every frame, what is alike over a patch of the surface, such as an error of the mesh, what the residuals of each patch
have in common, and the error of the earlier view that brightness is compared with. Only the first becomes smaller when
poses of a thing that stands are averaged.

The deviations of the terms were chosen so that the 95 % regions hold 92 to 98 % of the true poses of rendered
sequences; `tests/benchmarks/tracking/coverage.py` counts that on others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry.tracking.terms import Rows

UNKNOWN = np.array([1.0, 1.0, 1.0, 1.8, 1.8, 1.8])
"""Standard deviation that is stated of what no term determines [m, rad]; 1.8 rad is any turn."""
_LEAST = 0.02
"""Part of the error that independent residuals would leave, below which none is stated."""


@dataclass(frozen=True)
class Spread:
    """Errors of a fit, as matrices (6 + J, 6 + J) over a twist and the joints."""

    information: np.ndarray
    """Of all terms, H."""
    noise: np.ndarray
    """Covariance of H times the error, of what is new in every frame."""
    lasting: np.ndarray
    """The same of what stays."""

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
        rows: Of each term.
        earlier: (6, 6) covariance of the pose in the view that the last term compares brightness with; None without.
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
        # `told` is that of brightness, the last term: an error of the earlier pose is repeated by it.
        lasting += told[:, :6] @ earlier @ told[:6]
    return Spread(information, noise, lasting)
