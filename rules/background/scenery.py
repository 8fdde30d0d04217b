"""The visible empty scene, as common input of the rules of its geometry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dextera_build.geometry import transforms
from dextera_build.geometry.depth_view import DepthView

from .patch import SUPPORT, Patch

SOME = np.s_[::4, ::4]


@dataclass(frozen=True)
class Scenery(DepthView):
    """The empty scene in the view of its camera."""

    pixels: np.ndarray  # (H, W, 3) uint8, without objects
    labels: np.ndarray  # (H, W) int32, patch of each pixel
    patches: Sequence[Patch]
    k: np.ndarray  # (3, 3) intrinsics [px]
    world_from_camera: np.ndarray  # (4, 4)

    @cached_property
    def depth(self) -> np.ndarray:
        """Depth (H, W) of the patches [m]; 0 for pixels of no patch."""
        depth = np.zeros(self.labels.shape)
        for patch in self.patches:
            row, column = np.nonzero(self.labels == patch.number)
            found = patch.depth(np.stack([column, row], axis=-1).astype(np.float64), self.k)
            depth[row, column] = np.where(np.isfinite(found), found, 0.0)
        return depth

    @cached_property
    def _some(self) -> np.ndarray:
        """Points (h, w, 3) in the world frame [m], of every fourth row and column."""
        return self.world_points(SOME)

    @cached_property
    def points(self) -> np.ndarray:
        """Points (N, 3) in the world frame [m], of every fourth row and column, off the support."""
        return np.asarray(self._some[(self.depth[SOME] > 0) & (self.labels[SOME] != SUPPORT)])

    def points_of(self, number: int) -> np.ndarray:
        """Points (N, 3) in the world frame [m], of every fourth row and column of a patch."""
        return np.asarray(self._some[(self.depth[SOME] > 0) & (self.labels[SOME] == number)])

    def lift(self, pixel: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Points (..., 3) in the world frame [m] at pixels (..., 2) and depths (...)."""
        flat = (pixel - [self.k[0, 2], self.k[1, 2]]) / [self.k[0, 0], self.k[1, 1]] * depth[..., None]
        return transforms.apply(self.world_from_camera, np.concatenate([flat, depth[..., None]], axis=-1))

    def colours(self, points: np.ndarray, apart_m: float, *, unmeasured: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Colours (..., 3) float32 of world points (..., 3), and which of them the picture shows within `apart_m`.

        With `unmeasured`, pixels of no patch show the surface behind them at any depth.
        """
        row, column, inside, z = self.find(points)
        shown = inside & (np.abs(self.depth[row, column] - z) < apart_m)
        if unmeasured:
            shown |= inside & (self.depth[row, column] == 0)
        return self.pixels[row, column].astype(np.float32), shown

    def planes(self) -> list[tuple[np.ndarray, float, int]]:
        """Planes off the support, in the world frame: normal, offset, number of pixels."""
        turn, place = self.world_from_camera[:3, :3], self.world_from_camera[:3, 3]
        found = []
        for patch in self.patches:
            if patch.plane is not None and patch.number != SUPPORT:
                normal = turn @ patch.plane[0]
                count = int((self.labels == patch.number).sum())
                found.append((normal, patch.plane[1] - float(normal @ place), count))
        return found
