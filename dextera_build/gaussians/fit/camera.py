"""Camera of a picture of Gaussians; without Warp, because other renderers use it, too."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class FitCamera:
    """A pinhole camera in the world of the Gaussians."""

    k: np.ndarray  # (3, 3) intrinsics, integer pixel centres [px]
    world_from_camera: np.ndarray  # (4, 4), OpenCV axes
    size: tuple[int, int]  # rows, columns [px]
    near_m: float = 0.01  # smallest depth of a rendered mean [m]
