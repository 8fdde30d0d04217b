"""Depth, instance and texture renders of triangle meshes by ray casting, without a GL context.

Open3D casts the rays; it is imported at first use, because it takes a second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from dextera_build.geometry import cameras, transforms

NOTHING = np.uint32(0xFFFFFFFF)


@dataclass(frozen=True)
class Surface:
    """Triangles to render, in the world frame, with an optional texture."""

    vertices: np.ndarray  # (V, 3) float [m]
    faces: np.ndarray  # (F, 3) int
    uv: np.ndarray | None = None  # (F, 3, 2), origin lower left
    texture: np.ndarray | None = None  # (h, w, 3) uint8
    colour: tuple[float, float, float] = (0.7, 0.7, 0.7)


@dataclass(frozen=True)
class Render:
    """Rendering of surfaces by a camera."""

    depth: np.ndarray  # (H, W) float64, image-plane z [m]; 0 without a surface
    index: np.ndarray  # (H, W) int32, position in the list of surfaces; -1 without one
    face: np.ndarray  # (H, W) int64, face of that surface; -1 without one
    corner: np.ndarray  # (H, W, 3) float64, barycentric weights of the face's corners
    normal: np.ndarray  # (H, W, 3) float64, unit face normal in the world frame; 0 without a surface


def render(
    surfaces: Sequence[Surface], k: np.ndarray, world_from_camera: np.ndarray, height: int, width: int
) -> Render:
    """Cast one ray through every pixel centre.

    Args:
        surfaces: The scene; the nearest hit wins, from both sides.
        k: (3, 3) intrinsics [px], OpenCV convention.
        world_from_camera: (4, 4) T_world_camera, OpenCV axes.
        height: Rows [px].
        width: Columns [px].
    """
    directions = cameras.rays(height, width, k) @ world_from_camera[:3, :3].T
    origins = np.broadcast_to(world_from_camera[:3, 3], directions.shape)
    hits = cast(surfaces, np.concatenate([origins, directions], axis=-1))
    # Directions have image-plane z = 1, so the ray parameter is the depth.
    return Render(np.where(hits.index >= 0, hits.depth, 0.0), hits.index, hits.face, hits.corner, hits.normal)


def cast(surfaces: Sequence[Surface], rays: np.ndarray) -> Render:
    """Cast free rays.

    Args:
        surfaces: The scene.
        rays: (..., 6) origin and direction in the world frame; `depth` is in units of the direction's length.
    """
    shape = rays.shape[:-1]
    index = np.full(shape, -1, np.int32)
    if not surfaces:
        empty = np.zeros(shape)
        return Render(empty, index, index.astype(np.int64), np.zeros((*shape, 3)), np.zeros((*shape, 3)))
    answer = _answer(surfaces, rays)
    geometry = answer["geometry_ids"].numpy()
    hit = geometry != NOTHING
    index[hit] = geometry[hit].astype(np.int32)
    face = np.where(hit, answer["primitive_ids"].numpy().astype(np.int64), -1)
    weights = answer["primitive_uvs"].numpy().astype(np.float64)
    corner = np.stack([1.0 - weights.sum(axis=-1), weights[..., 0], weights[..., 1]], axis=-1)
    normal = np.where(hit[..., None], answer["primitive_normals"].numpy(), 0.0).astype(np.float64)
    depth = np.where(hit, answer["t_hit"].numpy(), np.inf).astype(np.float64)
    return Render(depth, index, face, corner, normal)


def distances(surfaces: Sequence[Surface], rays: np.ndarray) -> np.ndarray:
    """Distances (...) float32 of the first hits of free rays, as `depth` of `cast`; infinite without a hit.

    A fast path for fits, which cast some thousand times.

    Args:
        surfaces: The scene; not empty.
        rays: (..., 6) float32 origin and direction in the world frame.
    """
    return np.asarray(_answer(surfaces, rays)["t_hit"].numpy())


def _answer(surfaces: Sequence[Surface], rays: np.ndarray) -> Any:
    """Open3D's result for rays (..., 6)."""
    import open3d as o3d

    scene = surfaces.tree if isinstance(surfaces, Sorted) else _tree(surfaces)
    return scene.cast_rays(o3d.core.Tensor(np.ascontiguousarray(rays, np.float32)))


class Sorted(tuple[Surface, ...]):
    """Surfaces with a prebuilt tree, for many renders."""

    @cached_property
    def tree(self) -> Any:
        """Open3D's scene."""
        return _tree(self)


def _tree(surfaces: Sequence[Surface]) -> Any:
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene(nthreads=0)
    for surface in surfaces:
        scene.add_triangles(
            o3d.core.Tensor(np.ascontiguousarray(surface.vertices, np.float32)),
            o3d.core.Tensor(np.ascontiguousarray(surface.faces, np.uint32)),
        )
    return scene


def shade(surfaces: Sequence[Surface], seen: Render) -> np.ndarray:
    """Unlit colours (H, W, 3) uint8 of a render: nearest texel, or the plain colour; black without a surface."""
    pixels = np.zeros((*seen.index.shape, 3), np.uint8)
    for number, surface in enumerate(surfaces):
        here = seen.index == number
        if not here.any():
            continue
        if surface.uv is None or surface.texture is None:
            pixels[here] = np.round(np.array(surface.colour) * 255).astype(np.uint8)
            continue
        uv = (surface.uv[seen.face[here]] * seen.corner[here][..., None]).sum(axis=1)
        rows, columns = surface.texture.shape[:2]
        column = np.clip((uv[:, 0] * columns).astype(int), 0, columns - 1)
        row = np.clip(((1.0 - uv[:, 1]) * rows).astype(int), 0, rows - 1)
        pixels[here] = surface.texture[row, column]
    return pixels


def posed(vertices: np.ndarray, faces: np.ndarray, world_from_object: np.ndarray) -> Surface:
    """A plain surface of an object-frame mesh under a (4, 4) pose."""
    return Surface(transforms.apply(world_from_object, vertices), faces)
