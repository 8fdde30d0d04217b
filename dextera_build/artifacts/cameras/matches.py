"""Corresponding points of two pictures."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from dextera_build.artifacts.base import Array, Artifact


class Matches(Artifact):
    """Corresponding points of two pictures, one pair per row, best first."""

    first: Annotated[np.ndarray, Array("N 2", "float64", unit="px")]
    """Column and row in the first picture, integer pixel centres."""
    second: Annotated[np.ndarray, Array("N 2", "float64", unit="px")]
    """Column and row in the second picture, integer pixel centres."""
    confidence: Annotated[np.ndarray, Array("N", "float32")]
    """0 to 1, decreasing; its meaning depends on the method."""
    method: str
    """Detector and matcher."""
