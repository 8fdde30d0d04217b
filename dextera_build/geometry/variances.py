"""Joint estimation of parameters and of the variances of two error sources: restricted maximum likelihood.

Observations e_i ~ N(A_i d, s2 I + B_i diag(variances) B_i^T) in blocks: measurement noise, and a disturbance of each
block (a robot's pose) that affects all its observations. Restricted likelihood accounts for the parameters estimated
from the same data (Patterson and Thompson 1971), so that the variances of few blocks are not underestimated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

LIMIT = 1e3
"""Limit of the ratio of standard deviations to the typical ones, and of its inverse."""


@dataclass(frozen=True)
class Block:
    """Observations that share one disturbance, projected on an orthonormal basis of the space of the parameters."""

    error: np.ndarray  # (R,) observed minus predicted
    design: np.ndarray  # (R, P) derivative of the prediction with respect to the parameters
    disturbance: np.ndarray  # (R, Q) derivative with respect to the disturbance
    outside: float  # sum of squares that no parameter and no disturbance can explain
    freedom: int  # number of observations behind `outside`


@dataclass(frozen=True)
class Priors:
    """Prior of the standard deviations: medians, and standard deviation of their logarithms."""

    typical: np.ndarray  # (G,) measurement noise first, then each group of the disturbance
    groups: np.ndarray  # (Q,) group 1.. of each part of the disturbance
    doubt: float = 2.0


@dataclass(frozen=True)
class Fit:
    """A weighted least squares step with its weights."""

    step: np.ndarray  # (P,)
    covariance: np.ndarray  # (P, P)
    sigmas: np.ndarray  # (G,)


def fit(blocks: Sequence[Block], priors: Priors, first: np.ndarray | None = None) -> Fit:
    """Step of the parameters with maximum-likelihood standard deviations.

    Args:
        blocks: At least as many observations as parameters.
        priors: See `Priors`.
        first: (G,) initial standard deviations; None: the typical ones.
    """
    from scipy.optimize import minimize

    stacked = _Stacked(blocks, priors)
    begin = np.log(priors.typical if first is None else first)
    simplex = begin + np.vstack([np.zeros(len(begin)), 0.7 * np.eye(len(begin))])
    options = {"xatol": 0.01, "fatol": 0.003, "initial_simplex": simplex, "maxiter": 300}
    search: Any = minimize
    found = search(stacked.cost, begin, method="Nelder-Mead", options=options)
    return stacked.solved(stacked.limited(np.exp(np.clip(found.x, -40.0, 40.0))))


def weighted(blocks: Sequence[Block], priors: Priors, sigmas: np.ndarray) -> Fit:
    """Step of the parameters with known standard deviations (G,)."""
    return _Stacked(blocks, priors).solved(sigmas)


def block_covariance(block: Block, priors: Priors, sigmas: np.ndarray) -> np.ndarray:
    """Covariance (R, R) of the errors of a block, with these standard deviations (G,)."""
    spread = block.disturbance * sigmas[priors.groups]
    return np.asarray(sigmas[0] ** 2 * np.eye(len(block.error)) + spread @ spread.T)


class _Stacked:
    """All blocks at once; their numbers of rows are equal, because each is reduced to a pose."""

    def __init__(self, blocks: Sequence[Block], priors: Priors) -> None:
        self.priors = priors
        self.error = np.stack([block.error for block in blocks])
        self.design = np.stack([block.design for block in blocks])
        self.disturbance = np.stack([block.disturbance for block in blocks])
        self.outside = sum(block.outside for block in blocks)
        self.freedom = sum(block.freedom for block in blocks)

    def _normal(self, sigmas: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        spread = self.disturbance * sigmas[self.priors.groups]
        covariance = spread @ spread.transpose(0, 2, 1) + sigmas[0] ** 2 * np.eye(self.error.shape[1])
        root = np.linalg.cholesky(covariance)
        white = np.linalg.solve(root, np.concatenate([self.design, self.error[..., None]], axis=2))
        a, e = white[..., :-1].reshape(-1, self.design.shape[2]), white[..., -1].reshape(-1)
        volume = 2 * float(np.log(np.diagonal(root, axis1=1, axis2=2)).sum())
        return a.T @ a, a.T @ e, e, volume

    def limited(self, sigmas: np.ndarray) -> np.ndarray:
        """Standard deviations within `LIMIT` of the typical ones, to keep matrices well-conditioned."""
        return np.asarray(np.clip(sigmas, self.priors.typical / LIMIT, self.priors.typical * LIMIT))

    def cost(self, logs: np.ndarray) -> float:
        """Minus twice the logarithm of the restricted likelihood and the prior."""
        sigmas = self.limited(np.exp(np.clip(logs, -40.0, 40.0)))
        normal, right, error, volume = self._normal(sigmas)
        sign, size = np.linalg.slogdet(normal)
        if sign <= 0:
            return 1e12
        left = float(error @ error - right @ np.linalg.solve(normal, right))
        known = (((logs - np.log(self.priors.typical)) / self.priors.doubt) ** 2).sum()
        pixels = self.outside / sigmas[0] ** 2 + 2 * self.freedom * np.log(sigmas[0])
        return float(volume + left + size + pixels + known)

    def solved(self, sigmas: np.ndarray) -> Fit:
        normal, right, _, _ = self._normal(sigmas)
        covariance = np.linalg.inv(normal)
        return Fit(covariance @ right, (covariance + covariance.T) / 2, sigmas)
