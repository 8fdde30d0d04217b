"""One smooth surface of a photograph."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import planes

SUPPORT = 1
"""Label of the support."""
JOINED_M = 0.03
"""Maximum depth difference between corners of a face on a curved surface [m]."""
DIVISIONS = 3
"""Number of times that the edges of a steep face are halved."""


@dataclass(frozen=True)
class Patch:
    """One smooth surface."""

    number: int
    """Its label."""
    plane: planes.Plane | None
    """In the camera frame; None for a curved surface."""
    corner: tuple[int, int] = (0, 0)
    """First row and column of `inverse`."""
    inverse: np.ndarray | None = None
    """(h, w) float32, 1 / depth of a curved surface and its surroundings [1/m]."""

    def depth(self, pixel: np.ndarray, k: np.ndarray) -> np.ndarray:
        """Depth (...) [m] at pixels (..., 2), column and row, also outside the picture; infinite where undefined."""
        if self.plane is None:
            assert self.inverse is not None
            return np.asarray(1.0 / _sampled(self.inverse, pixel - self.corner[::-1]))
        normal, offset = self.plane
        ray = [(pixel[..., 0] - k[0, 2]) / k[0, 0], (pixel[..., 1] - k[1, 2]) / k[1, 1]]
        down = -(ray[0] * normal[0] + ray[1] * normal[1] + normal[2])
        with np.errstate(divide="ignore"):
            depth = offset / down
        return np.where((down > 1e-6) & (depth > 0), depth, np.inf)

    def fine(
        self, pixel: np.ndarray, faces: np.ndarray, k: np.ndarray, push: float = 1.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Corners (V, 2) and faces (F, 3) of a triangulation in the picture without faces across depth steps.

        Faces of a plane cross no step. Steep faces of a curved surface are divided; a face that is still steep when it
        is smaller than a pixel is a step and is dropped. `push` is a factor of all depths.
        """
        if self.plane is not None:
            return pixel, faces
        for _ in range(DIVISIONS):
            steep = np.ptp(self.depth(pixel, k)[faces], axis=1) > JOINED_M / push
            a, b, c = (faces[steep][:, corner] for corner in range(3))
            middles = np.concatenate([(pixel[i] + pixel[j]) / 2 for i, j in ((a, b), (b, c), (c, a))])
            ab, bc, ca = np.split(len(pixel) + np.arange(len(middles)), 3)
            quarters = [np.stack(each, axis=1) for each in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
            pixel, faces = np.concatenate([pixel, middles]), np.concatenate([faces[~steep], *quarters])
        return pixel, faces[np.ptp(self.depth(pixel, k)[faces], axis=1) <= JOINED_M / push]


def _sampled(values: np.ndarray, pixel: np.ndarray) -> np.ndarray:
    """`values` (h, w) between their pixels, at (..., 2) column and row; those of the border beyond it."""
    place = np.clip(pixel, 0, [values.shape[1] - 1, values.shape[0] - 1])
    first = np.minimum(place.astype(np.int64), [max(0, values.shape[1] - 2), max(0, values.shape[0] - 2)])
    column, row = first[..., 0], first[..., 1]
    right, below = np.minimum(column + 1, values.shape[1] - 1), np.minimum(row + 1, values.shape[0] - 1)
    u, v = (place - first)[..., 0], (place - first)[..., 1]
    upper = values[row, column] * (1 - u) + values[row, right] * u
    return np.asarray(upper * (1 - v) + (values[below, column] * (1 - u) + values[below, right] * u) * v)
