"""One RGB-D frame, prepared for tracking."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from dextera_build.geometry import cameras

ROBOT = 127
"""Owner of the robot's pixels."""


@dataclass(frozen=True)
class Frame:
    """A frame with data shared by several objects."""

    rgb: np.ndarray
    """(H, W, 3) uint8."""
    depth: np.ndarray
    """(H, W) float32 image-plane z [m]; 0 where nothing was measured."""
    k: np.ndarray
    """(3, 3) intrinsics [px]."""
    stamp: float
    """Time [s]."""
    owner: np.ndarray = field(init=False)
    """(H, W) int8, number of the object assigned to a pixel, `ROBOT`, or -1 for none so far."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "owner", np.full(self.depth.shape, -1, np.int8))

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.depth.shape[0], self.depth.shape[1]

    @cached_property
    def grey(self) -> np.ndarray:
        """Brightness (H, W) uint8."""
        import cv2

        return np.asarray(cv2.cvtColor(self.rgb, cv2.COLOR_RGB2GRAY))

    @cached_property
    def smooth(self) -> np.ndarray:
        """Brightness (H, W) float32 without the finest detail, so that its gradient is valid over a few pixels."""
        import cv2

        return np.asarray(cv2.GaussianBlur(self.grey, (7, 7), 1.5).astype(np.float32))

    @cached_property
    def slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Gradient of `smooth` along columns and rows, (H, W) float32 [1/px]."""
        import cv2

        right = cv2.Sobel(self.smooth, cv2.CV_32F, 1, 0, scale=1 / 8)
        return np.asarray(right), np.asarray(cv2.Sobel(self.smooth, cv2.CV_32F, 0, 1, scale=1 / 8))

    def nearest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Row, column and whether it is in the picture, of the pixels of points (N, 3) in the camera frame."""
        return cameras.nearest_pixels(points, self.k, self.depth.shape)

    def others(self, rows: np.ndarray | slice, columns: np.ndarray | slice, number: int) -> np.ndarray:
        """Whether pixels are assigned to the robot, or to another object than `number`."""
        owner = self.owner[rows, columns]
        return np.asarray((owner >= 0) & (owner != number))

    def measured(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Points (N, 3) [m] at pixels; 0 where nothing was measured."""
        z = self.depth[rows, columns].astype(np.float64)
        x, y = (columns - self.k[0, 2]) / self.k[0, 0] * z, (rows - self.k[1, 2]) / self.k[1, 1] * z
        return np.stack([x, y, z], axis=-1)
