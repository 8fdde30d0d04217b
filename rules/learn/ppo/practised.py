"""The result of a backend of a reinforcement learning rule."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Practised:
    """Weights and training statistics."""

    weights: bytes
    """safetensors."""
    steps: np.ndarray
    """Decisions at the points of `reward` and `success`, (L,) int64."""
    reward: np.ndarray
    """Mean reward of the latest episodes, (L,) float32."""
    success: np.ndarray
    """Fraction of them that succeeded while exploring, (L,) float32."""
    episodes: int
    """Number of finished episodes."""
    share: float = 1.0
    """Fraction of the task's ranges from which the last starts were drawn."""
