"""The result of a backend of an imitation learning rule."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Trained:
    """Weights and training statistics."""

    weights: bytes
    """safetensors."""
    steps: np.ndarray
    """Optimiser steps of `curve`, (L,) int64."""
    curve: np.ndarray
    """Training loss, normalised, (L,) float32."""
    held_out: tuple[np.ndarray, np.ndarray]
    """Steps and loss of the held-out episodes."""
    error_rad: float
    """Mean absolute error of the held-out chunks at the end [rad]; 0 if none is held out."""
    snapshots: dict[str, bytes] = field(default_factory=dict)
    """Step -> weights, see `Checkpoint.snapshots`."""
