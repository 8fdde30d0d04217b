"""A generated scene as its renderer: colours, depth and opacity from any place."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.geometry import Mesh
from dextera_build.artifacts.splats import Splats
from dextera_build.geometry import raycast
from dextera_build.geometry.photo_terms import Drawn
from dextera_build.geometry.scene_alignment import Render

FINE = 2
"""Rays per pixel and axis: a ray shows one texel, and pixels as large as many texels would flicker."""


def of_mesh(mesh: Mesh) -> Render:
    """A textured surface, by ray casting."""
    texture = None if mesh.texture is None else mesh.texture.pixels
    surfaces = raycast.Sorted([raycast.Surface(mesh.vertices, mesh.faces, mesh.uv, texture, mesh.colour)])

    def render(scene_from_camera: np.ndarray, k: np.ndarray, size: tuple[int, int]) -> Drawn:
        rows, columns = size
        fine = k.copy()
        fine[:2] *= FINE
        fine[:2, 2] += (FINE - 1) / 2  # integer pixel centres
        seen = raycast.render(surfaces, fine, scene_from_camera, FINE * rows, FINE * columns)
        there = (seen.index >= 0).astype(float)
        parts = np.dstack([raycast.shade(surfaces, seen) / 255.0 * there[..., None], seen.depth, there])
        means = parts.reshape(rows, FINE, columns, FINE, 5).mean(axis=(1, 3))
        part = np.maximum(means[..., 4:], 1e-9)
        # Depths of two surfaces are not averaged: a mean would lie between them.
        depth = seen.depth[FINE // 2 :: FINE, FINE // 2 :: FINE]
        return Drawn(means[..., :3] / part, depth, means[..., 4])

    return render


def of_splats(splats: Splats, device: str) -> Render:
    """3D Gaussians, by the rasteriser in NVIDIA Warp."""
    import torch
    import warp as wp

    from dextera_build.learning.gaussian_fit.camera import Camera as Eye
    from dextera_build.learning.gaussian_fit.parameters import opened
    from dextera_build.learning.rasteriser.raster import Parameters, Rasteriser

    given = splats.gaussians
    tensors = opened(given, device, round(np.sqrt(given.harmonics.shape[1])) - 1)
    maker = Rasteriser(device)
    kinds = (wp.vec3, wp.vec4, wp.vec3, wp.float32, wp.vec3)
    arrays = Parameters(*(wp.from_torch(each, dtype=kind) for each, kind in zip(tensors, kinds, strict=True)))
    near = 1e-3 * float(torch.quantile(torch.tensor(np.ptp(given.means, axis=0)), 0.5)) if len(given) else 0.01

    def render(scene_from_camera: np.ndarray, k: np.ndarray, size: tuple[int, int]) -> Drawn:
        picture = maker.forward(arrays, Eye(k, scene_from_camera, size, near))
        opacity = 1.0 - picture.light.numpy().reshape(size).astype(float)
        part = np.maximum(opacity, 1e-6)
        depth = picture.depth.numpy().reshape(size) / part
        colour = picture.colour.numpy().reshape(*size, 3).astype(float) / part[..., None]
        # Colours on black are divided by their opacity: black where nothing is seen would attract the pose.
        return Drawn(colour.clip(0, 1), np.where(opacity > 0.5, depth, 0.0), opacity)

    return render
