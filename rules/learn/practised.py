"""The result of a backend of a reinforcement rule."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Practised:
    """Weights and how the training went."""

    weights: bytes
    """safetensors."""
    steps: np.ndarray
    """Decisions at which `reward` and `success` were taken, (L,) int64."""
    reward: np.ndarray
    """Mean reward of the latest episodes, (L,) float32."""
    success: np.ndarray
    """Share of them that succeeded while exploring, (L,) float32."""
    episodes: int
    """Episodes that ended."""
