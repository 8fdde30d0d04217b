"""A generated scene as its renderer: colours, depth and opacity from any place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from dextera_build.artifacts.geometry import Mesh
from dextera_build.artifacts.splats import Splats
from dextera_build.geometry import merging, raycast
from dextera_build.geometry.photo_terms import Drawn
from dextera_build.geometry.scene_alignment import Render
from dextera_build.learning.gaussian_fit.camera import Camera as Eye

FINE = 2
"""Rays per pixel and axis: a ray shows one texel, and pixels as large as many texels would flicker."""
FAINT = 0.1
"""Less opacity than this has no depth."""
ALIKE = 1.03
"""What is farther than this multiple of the nearest depth in a pixel is another surface."""
CELL_PX = 0.7
"""Gaussians that lie together in a cell of this width of a small picture are drawn as one [px]."""


View = tuple[np.ndarray, tuple[int, int]]
"""Intrinsics (3, 3) of a picture [px], and its rows and columns [px]."""


class DrawnScene(Protocol):
    """A scene that can be drawn."""

    def whole(self) -> Render:
        """From any place and at any size."""
        ...

    def around(self, place: np.ndarray, views: Sequence[View]) -> Render:
        """From near `place`, T_G_C (4, 4), in pictures of one camera at different sizes."""
        ...


class MeshScene:
    """A textured surface, by ray casting."""

    def __init__(self, mesh: Mesh) -> None:
        texture = None if mesh.texture is None else mesh.texture.pixels
        self._surfaces = raycast.Sorted([raycast.Surface(mesh.vertices, mesh.faces, mesh.uv, texture, mesh.colour)])

    def whole(self) -> Render:
        """From any place and at any size."""
        return self._drawn

    def around(self, place: np.ndarray, views: Sequence[View]) -> Render:
        """The same: the time of ray casting depends on the picture alone."""
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
        # Depths of two surfaces are not averaged: a mean would lie between them.
        depth = seen.depth[FINE // 2 :: FINE, FINE // 2 :: FINE]
        return Drawn(means[..., :3] / part, depth, means[..., 4])


class SplatScene:
    """3D Gaussians, drawn by the rasteriser in NVIDIA Warp.

    Args:
        splats: The scene.
        device: `cpu` or `cuda`.
    """

    def __init__(self, splats: Splats, device: str) -> None:
        from dextera_build.learning.rasteriser.raster import Rasteriser

        self._given, self._device = splats.gaussians, device
        self._maker = Rasteriser(device)
        self._near = 1e-3 * float(np.median(np.ptp(self._given.means, axis=0))) if len(self._given) else 0.01

    def whole(self) -> Render:
        """All of them, from any place and at any size."""
        from dextera_build.learning.rasteriser.placing import placed

        arrays = placed(self._given, self._device)

        def render(place: np.ndarray, k: np.ndarray, size: tuple[int, int]) -> Drawn:
            eye = Eye(k, place, size, self._near)
            sharp = self._drawn(arrays, eye, faded=False)
            # Feature points need sharp edges. Their depth is the mean over the surface in a pixel: the nearest of
            # several noisy Gaussians would be too near.
            mean = self._drawn(arrays, eye, np.where(sharp.solid, ALIKE * sharp.depth, np.inf), faded=True)
            return Drawn(sharp.rgb, np.where((mean.depth > 0) & sharp.solid, mean.depth, sharp.depth), sharp.opacity)

        return render

    def around(self, place: np.ndarray, views: Sequence[View]) -> Render:
        """What cameras near `place`, T_G_C (4, 4), see of them, at the given sizes and with few Gaussians for each.

        Args:
            place: From where it is drawn, about.
            views: (3, 3) intrinsics [px] with rows and columns [px], all of one camera.
        """
        from dextera_build.learning.rasteriser.placing import placed

        fewer, arrays = self._given, {}
        for k, size in sorted(views, key=lambda view: -view[1][1]):  # those of a large picture do for a small one, too
            fewer = merging.merged(fewer, k, place, size, CELL_PX)
            arrays[size] = placed(fewer, self._device)
        return lambda near, k, size: self._drawn(arrays[size], Eye(k, near, size, self._near), faded=True)

    def _drawn(self, arrays: Any, eye: Eye, limits: np.ndarray | None = None, *, faded: bool) -> Drawn:
        import warp as wp

        size = eye.size
        if limits is not None:
            limits = wp.array(limits.reshape(-1).astype(np.float32), device=self._device)
        picture = self._maker.forward(arrays, eye, limits, faded=faded)
        opacity = 1.0 - picture.light.numpy().reshape(size).astype(float)
        part = np.maximum(opacity, 1e-6)
        depth = picture.depth.numpy().reshape(size) / part
        colour = picture.colour.numpy().reshape(*size, 3).astype(float) / part[..., None]
        # Colours on black are divided by their opacity: black where nothing is seen would attract the pose.
        return Drawn(colour.clip(0, 1), np.where(opacity > FAINT, depth, 0.0), opacity)
