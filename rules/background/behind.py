"""What further photographs show where the first one shows what stands on the support."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Behind:
    """The scene without what stands on the support, from the first camera."""

    pixels: np.ndarray  # (H, W, 3) uint8
    depth: np.ndarray  # (H, W) float32 [m]
    source: np.ndarray  # (H, W) int32, the further photograph that shows it, 1..; 0 for none

    @property
    def mask(self) -> np.ndarray:
        """Pixels (H, W) that one of the photographs shows."""
        return np.asarray(self.source > 0)
