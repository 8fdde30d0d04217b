"""Depth, instance and texture renders of triangle meshes by ray casting, without a GL context.

Open3D casts the rays; it is imported at first use, because it takes a second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from dextera_build.geometry import cameras, open3d_core, transforms

NOTHING = np.uint32(0xFFFFFFFF)


class Hits(NamedTuple):
    """First hits of rays (...), as Open3D returns them."""

    distance: np.ndarray
    """(...) float32, in lengths of the direction; infinite without a hit."""
    surface: np.ndarray
    """(...) uint32, number of the mesh; `NOTHING` without a hit."""
    face: np.ndarray
    """(...) uint32, face of that mesh."""
    weights: np.ndarray
    """(..., 2) float32, barycentric weights of the face's second and third corner."""
    normals: np.ndarray
    """(..., 3) float32, unit normal of the face."""


class RayScene:
    """Triangle meshes that are prepared for rays and distances.

    Args:
        meshes: Vertices (V, 3) and faces (F, 3) of each.
        threads: Number of threads that prepare them, 0 for all; one is enough for small meshes.
    """

    def __init__(self, *meshes: tuple[np.ndarray, np.ndarray], threads: int = 1) -> None:
        o3d = open3d_core.loaded()

        self._tensor = o3d.core.Tensor
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=threads)
        for vertices, faces in meshes:
            self._scene.add_triangles(
                self._tensor(np.ascontiguousarray(vertices, np.float32)),
                self._tensor(np.ascontiguousarray(faces, np.uint32)),
            )

    def cast(self, rays: np.ndarray) -> Hits:
        """First hits of rays (..., 6), origin and direction."""
        found = self._scene.cast_rays(self._tensor(np.ascontiguousarray(rays, np.float32)))
        names = ("t_hit", "geometry_ids", "primitive_ids", "primitive_uvs", "primitive_normals")
        return Hits(*(found[name].numpy() for name in names))

    def occluded(self, rays: np.ndarray, far: float) -> np.ndarray:
        """Whether rays (..., 6) hit anything before `far` lengths of their direction, (...) bool."""
        rays = np.ascontiguousarray(rays, np.float32)
        return np.asarray(self._scene.test_occlusions(self._tensor(rays), tfar=far).numpy())

    def distances(self, points: np.ndarray) -> np.ndarray:
        """Distance (N,) float32 of points (N, 3) to the nearest mesh."""
        points = np.ascontiguousarray(points, np.float32)
        return np.asarray(self._scene.compute_distance(self._tensor(points)).numpy())


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
    hits = _prepared(surfaces).cast(rays)
    hit = hits.surface != NOTHING
    index[hit] = hits.surface[hit].astype(np.int32)
    face = np.where(hit, hits.face.astype(np.int64), -1)
    weights = hits.weights.astype(np.float64)
    corner = np.stack([1.0 - weights.sum(axis=-1), weights[..., 0], weights[..., 1]], axis=-1)
    normal = np.where(hit[..., None], hits.normals, 0.0).astype(np.float64)
    depth = np.where(hit, hits.distance, np.inf).astype(np.float64)
    return Render(depth, index, face, corner, normal)


class Sorted(tuple[Surface, ...]):
    """Surfaces that are prepared once, for many renders."""

    @cached_property
    def scene(self) -> RayScene:
        """All of them."""
        return ray_scene(self)


def ray_scene(surfaces: Sequence[Surface]) -> RayScene:
    """Prepare surfaces for rays and distances."""
    return RayScene(*((each.vertices, each.faces) for each in surfaces), threads=0)


def _prepared(surfaces: Sequence[Surface]) -> RayScene:
    return surfaces.scene if isinstance(surfaces, Sorted) else ray_scene(surfaces)


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
