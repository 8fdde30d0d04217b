"""Renderers of a generated scene: colours, depth and opacity from any pose."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.gaussians import merging
from dextera_build.gaussians.fit.camera import FitCamera
from dextera_build.geometry import raycast
from dextera_build.geometry.photo_terms import Drawn
from dextera_build.geometry.scene_alignment import Render

FINE = 2
"""Rays per pixel and axis: a ray samples one texel, so pixels as large as many texels would alias."""
FAINT = 0.1
"""Opacity below which a pixel has no depth."""
ALIKE = 1.03
"""Surfaces farther than this multiple of the nearest depth in a pixel are separate."""
CELL_PX = 0.7
"""Gaussians in one cell of this width of a small picture are merged [px]."""


View = tuple[np.ndarray, tuple[int, int]]
"""Intrinsics (3, 3) of a picture [px], and its rows and columns [px]."""


class MeshScene:
    """A textured surface, by ray casting."""

    def __init__(self, mesh: Mesh) -> None:
        texture = None if mesh.texture is None else mesh.texture.pixels
        self._surfaces = raycast.Sorted([raycast.Surface(mesh.vertices, mesh.faces, mesh.uv, texture, mesh.colour)])

    def whole(self) -> Render:
        """From any pose and at any size."""
        return self._drawn

    def around(self, place: np.ndarray, views: Sequence[View]) -> Render:
        """The same: the time of ray casting depends only on the picture."""
        return self._drawn

    def _drawn(self, scene_from_camera: np.ndarray, k: np.ndarray, size: tuple[int, int]) -> Drawn:
        rows, columns = size
        fine = k.copy()
        fine[:2] *= FINE
        fine[:2, 2] += (FINE - 1) / 2  # integer pixel centres
        seen = raycast.render(self._surfaces, fine, scene_from_camera, FINE * rows, FINE * columns)
        there = (seen.index >= 0).astype(float)
        parts = np.dstack([raycast.shade(self._surfaces, seen) / 255.0 * there[..., None], seen.depth, there])
        means = parts.reshape(rows, FINE, columns, FINE, 5).mean(axis=(1, 3))
        part = np.maximum(means[..., 4:], 1e-9)
        # Depths of two surfaces are not averaged: the mean would be between them.
        depth = seen.depth[FINE // 2 :: FINE, FINE // 2 :: FINE]
        return Drawn(means[..., :3] / part, depth, means[..., 4])


class SplatScene:
    """3D Gaussians, rendered by the rasteriser in NVIDIA Warp.

    Args:
        splats: The scene.
        device: `cpu` or `cuda`.
    """

    def __init__(self, splats: Splats, device: str) -> None:
        from dextera_build.gaussians.rasteriser.raster import Rasteriser

        self._given, self._device = splats.gaussians, device
        self._maker = Rasteriser(device)
        self._near = 1e-3 * float(np.median(np.ptp(self._given.means, axis=0))) if len(self._given) else 0.01

    def whole(self) -> Render:
        """All Gaussians, from any pose and at any size."""
        from dextera_build.gaussians.rasteriser.placing import placed

        arrays = placed(self._given, self._device)

        def render(place: np.ndarray, k: np.ndarray, size: tuple[int, int]) -> Drawn:
            eye = FitCamera(k, place, size, self._near)
            sharp = self._drawn(arrays, eye, faded=False)
            # Feature points need sharp edges. Their depth is the mean over the surface in a pixel: the nearest of
            # several noisy Gaussians would be too near.
            mean = self._drawn(arrays, eye, np.where(sharp.solid, ALIKE * sharp.depth, np.inf), faded=True)
            return Drawn(sharp.rgb, np.where((mean.depth > 0) & sharp.solid, mean.depth, sharp.depth), sharp.opacity)

        return render

    def around(self, place: np.ndarray, views: Sequence[View]) -> Render:
        """Gaussians visible to cameras near `place`, T_G_C (4, 4), reduced for each of the given sizes.

        Args:
            place: Approximate pose of the cameras.
            views: (3, 3) intrinsics [px] with rows and columns [px], all of one camera.
        """
        from dextera_build.gaussians.rasteriser.placing import placed

        fewer, arrays = self._given, {}
        for k, size in sorted(views, key=lambda view: -view[1][1]):  # valid for a small picture, too
            fewer = merging.merged(fewer, k, place, size, CELL_PX)
            arrays[size] = placed(fewer, self._device)
        return lambda near, k, size: self._drawn(arrays[size], FitCamera(k, near, size, self._near), faded=True)

    def _drawn(self, arrays: Any, eye: FitCamera, limits: np.ndarray | None = None, *, faded: bool) -> Drawn:
        import warp as wp

        size = eye.size
        if limits is not None:
            limits = wp.array(limits.reshape(-1).astype(np.float32), device=self._device)
        picture = self._maker.forward(arrays, eye, limits, faded=faded)
        opacity = 1.0 - picture.light.numpy().reshape(size).astype(float)
        part = np.maximum(opacity, 1e-6)
        depth = picture.depth.numpy().reshape(size) / part
        colour = picture.colour.numpy().reshape(*size, 3).astype(float) / part[..., None]
        # Colours over black are divided by their opacity; black where nothing is rendered would attract the pose.
        return Drawn(colour.clip(0, 1), np.where(opacity > FAINT, depth, 0.0), opacity)
