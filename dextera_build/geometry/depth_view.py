"""A picture with the depth of its pixels, from a camera with a pose: points of its pixels, and pixels of points."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dextera_build.geometry import cameras, transforms


class DepthView:
    """Base of classes that hold such a picture; they add its colours, and the masks they need."""

    if TYPE_CHECKING:
        # Fields or properties of the classes: at run time, a property here would be the default of their fields.
        @property
        def depth(self) -> np.ndarray:
            """(H, W) image-plane z [m]; 0 where nothing was measured."""

        @property
        def k(self) -> np.ndarray:
            """(3, 3) intrinsics [px]."""

        @property
        def world_from_camera(self) -> np.ndarray:
            """T_world_camera, (4, 4)."""

    def camera_points(self, where: Any = ...) -> np.ndarray:
        """Points (..., 3) float64 of the pixels that the index `where` chooses, in the camera frame [m]."""
        return np.asarray(cameras.backproject(self.depth, self.k)[where])

    def world_points(self, where: Any = ...) -> np.ndarray:
        """Points (..., 3) float64 of the pixels that the index `where` chooses, in the world frame [m]."""
        return transforms.apply(self.world_from_camera, self.camera_points(where))

    def find(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Row and column of the pixel nearest to each world point (..., 3), whether it is in view, and its z [m].

        Rows and columns are clipped to the picture, see `cameras.nearest_pixels`.
        """
        local = transforms.apply(transforms.invert(self.world_from_camera), points)
        return *cameras.nearest_pixels(local, self.k, self.depth.shape), local[..., 2]
