"""Warp the support to a top view and back, for perspective-correct filling."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.geometry import transforms

MOST_TEXELS = 900
"""Longest side of the rectified picture [texels]."""


@dataclass(frozen=True)
class TopView:
    """A rectified piece of the support: texel (row, column) is world (left + column * texel, top - row * texel)."""

    left: float
    top: float
    texel: float  # edge of a texel [m]
    width: int
    height: int
    pixel_from_texel: np.ndarray  # (3, 3) homography to the photograph

    def distance(self) -> np.ndarray:
        """Distance of each texel from the camera, (height, width), up to a factor."""
        rows, columns = np.indices((self.height, self.width))
        row = self.pixel_from_texel[2]
        return np.asarray(row[0] * columns + row[1] * rows + row[2], np.float32)

    def lay(self, picture: np.ndarray, smooth: bool = True) -> np.ndarray:
        """Warp the photograph's `picture` (H, W[, C]) to the top view; 0 outside it."""
        how = cv2.INTER_LINEAR if smooth else cv2.INTER_NEAREST
        flags = how | cv2.WARP_INVERSE_MAP
        return np.asarray(cv2.warpPerspective(picture, self.pixel_from_texel, (self.width, self.height), flags=flags))

    def lift(self, picture: np.ndarray, size: tuple[int, int], smooth: bool = True) -> np.ndarray:
        """Warp a top view back to the camera, (H, W[, C]) of `size` (height, width); 0 outside it."""
        how = cv2.INTER_LINEAR if smooth else cv2.INTER_NEAREST
        back = np.linalg.inv(self.pixel_from_texel)
        return np.asarray(cv2.warpPerspective(picture, back, size[::-1], flags=how | cv2.WARP_INVERSE_MAP))


def top_view(
    spots: np.ndarray, limits: np.ndarray, margin: float, texel: float, camera: Camera, world_from_camera: np.ndarray
) -> TopView:
    """Create a top view of `spots` and their surroundings.

    Args:
        spots: (N, 2) points on the support that it must contain, world frame [m].
        limits: (M, 2) points; the view stays inside their bounding box [m].
        margin: Border around the spots [m].
        texel: Smallest texel [m]; enlarged if the view would exceed `MOST_TEXELS`.
        camera: Intrinsics [px].
        world_from_camera: (4, 4) T_world_camera.
    """
    low = np.maximum(spots.min(axis=0) - margin, limits.min(axis=0))
    high = np.minimum(spots.max(axis=0) + margin, limits.max(axis=0))
    texel = max(texel, float((high - low).max()) / MOST_TEXELS)
    width, height = (int(n) for n in np.ceil((high - low) / texel) + 1)
    back = transforms.invert(world_from_camera)
    pixel_from_plane = camera.matrix() @ np.stack([back[:3, 0], back[:3, 1], back[:3, 3]], axis=1)
    plane_from_texel = np.array([[texel, 0, low[0]], [0, -texel, high[1]], [0, 0, 1]])
    return TopView(float(low[0]), float(high[1]), texel, width, height, pixel_from_plane @ plane_from_texel)
