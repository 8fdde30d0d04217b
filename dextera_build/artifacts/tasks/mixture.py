"""Mixtures: episode sets of one task, of which every training batch holds fixed numbers."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from dextera_build.artifacts.base import Array, Artifact
from dextera_build.artifacts.tasks.episode import Episodes


class Mixture(Artifact):
    """Several episode sets with weights: `{twin: 1, reference: 1}` is half a batch each, whatever their sizes."""

    parts: dict[str, Episodes]
    """Label -> its episodes."""
    weights: dict[str, int]
    """Label -> its samples per `sum(weights)` samples of a batch."""
    action_mean: dict[str, Annotated[np.ndarray, Array("A", "float64", unit="rad")]]
    """Label -> mean of its actions over all steps."""
    action_sigma: dict[str, Annotated[np.ndarray, Array("A", "float64", unit="rad")]]
    """Label -> standard deviation of its actions over all steps."""
