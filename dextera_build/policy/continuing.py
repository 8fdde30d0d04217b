"""Answers that continue the steps that a robot carries out meanwhile: real-time chunking.

Black, Galliker and Levine 2025, Real-Time Execution of Action Chunking Flow Policies, arXiv 2506.07339.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from dextera_build.policy.features import Fields


@dataclass(frozen=True)
class Plan:
    """What a robot is told around the present step."""

    past: np.ndarray
    """Targets (P, A) of the last steps before the present one [rad or m], the oldest first."""
    ahead: np.ndarray
    """Targets (N, A) that are left of the last answer, from the present step on [rad or m]."""
    frozen: int
    """Number of them that are carried out before the next answer can arrive."""

    def weights(self) -> np.ndarray:
        """How firmly each step of `ahead` is kept (N,), 1: wholly, 0: not at all; their soft mask.

        With d frozen steps, of the other steps i = d ... N - 1 each is kept by c (e^c - 1) / (e - 1), where c = (N - i)
        / (N - d + 1): the farther ahead, the more may what was seen since then change it.
        """
        count = len(self.ahead)
        frozen = min(self.frozen, count)
        share = (count - np.arange(count)) / (count - frozen + 1)
        return np.where(np.arange(count) < frozen, 1.0, share * np.expm1(share) / np.expm1(1.0))


@runtime_checkable
class Continues(Protocol):
    """A `Predict` whose answers can continue a plan."""

    def __call__(self, inputs: Fields, step: int) -> np.ndarray:
        """As `Predict`."""
        ...

    def continued(self, inputs: Fields, step: int, plan: Plan | None) -> np.ndarray:
        """Joint targets (C, A) [rad] for `step` and all those after it that are predicted; None: without a plan."""
        ...
