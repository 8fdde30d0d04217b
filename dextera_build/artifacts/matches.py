"""Points of two pictures that show the same places."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

import numpy as np

from dextera_build.artifacts.base import Array, Artifact


class Matches(Artifact):
    """Points of two pictures that show the same places, one pair per row, best first."""

    first: Annotated[np.ndarray, Array("N 2", "float64", unit="px")]
    """Column and row in the first picture, integer pixel centres."""
    second: Annotated[np.ndarray, Array("N 2", "float64", unit="px")]
    """Column and row in the second picture, integer pixel centres."""
    confidence: Annotated[np.ndarray, Array("N", "float32")]
    """0 to 1, decreasing; its meaning is that of the method."""
    method: str
    """What found and compared the points."""

    def facts(self) -> Iterator[str]:
        """Number of pairs, and the method."""
        yield f"{len(self.first)} pairs"
        yield self.method
