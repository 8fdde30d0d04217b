"""Soft light by ray casting: the visibility of the sky and of an area lamp at each pixel.

An extended lamp causes penumbras, and sky occlusion the dark seams under objects, as in photographs. Rays start from
every other pixel, sixteen patterns alternate between neighbours, and averaging over neighbours on the same surface
removes the pattern. All samples are fixed: the same model gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.geometry import cameras, raycast

PATTERN = 4
"""Edge of the tile of pixels that share one set of samples [px]."""
SAMPLES = 8
"""Rays of each kind per pixel."""
LIFT_M = 0.001
"""Offset of ray origins from the surface [m]."""


def light(
    surfaces: Sequence[raycast.Surface],
    camera: Camera,
    world_from_camera: np.ndarray,
    depth: np.ndarray,
    lamp: np.ndarray,
    *,
    radius_rad: float,
    reach_m: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Visible fractions (H, W) float64 0..1 of the sky and of the lamp at each pixel.

    Args:
        surfaces: All shadow casters, in the world frame.
        camera: Intrinsics [px]; width and height even.
        world_from_camera: (4, 4) T_world_camera, OpenCV axes.
        depth: (H, W) image-plane z of the picture [m], which guides the upsampling.
        lamp: (3,) direction of the lamp's light.
        radius_rad: Angular radius of the lamp [rad].
        reach_m: Maximum distance of surfaces that hide the sky [m].
    """
    half = _halved(camera)
    seen = raycast.render(surfaces, half.matrix(), world_from_camera, half.height, half.width)
    hit = seen.index >= 0
    directions = cameras.rays(half.height, half.width, half.matrix()) @ world_from_camera[:3, :3].T
    facing = -np.sign((seen.normal * directions).sum(axis=-1))
    normals = (seen.normal * facing[..., None])[hit]
    points = (world_from_camera[:3, 3] + directions * seen.depth[..., None])[hit] + LIFT_M * normals
    row, column = np.nonzero(hit)
    tile = (row % PATTERN) * PATTERN + column % PATTERN
    scene = raycast.ray_scene(surfaces)
    sky, key = np.ones(hit.shape), np.ones(hit.shape)
    sky[hit] = _open(scene, points, _hemisphere(normals, tile), reach_m)
    key[hit] = _open(scene, points, _disc(-lamp / np.linalg.norm(lamp), radius_rad, tile), np.inf)
    smooth = _smoothed(np.stack([sky, key], axis=-1), seen)
    full = _doubled(smooth, seen.depth, depth)
    return full[..., 0], full[..., 1]


def _halved(camera: Camera) -> Camera:
    return Camera(
        width=camera.width // 2,
        height=camera.height // 2,
        fx=camera.fx / 2,
        fy=camera.fy / 2,
        cx=(camera.cx + 0.5) / 2 - 0.5,
        cy=(camera.cy + 0.5) / 2 - 0.5,
    )


def _sequence(tile: np.ndarray, sample: int) -> tuple[np.ndarray, np.ndarray]:
    """Two numbers 0..1 per pixel: Roberts' R2 sequence, distributed over the pixels of a tile."""
    index = sample * PATTERN * PATTERN + (tile * 7) % (PATTERN * PATTERN) + 1
    return (0.7548776662466927 * index) % 1.0, (0.5698402909980532 * index) % 1.0


def _hemisphere(normals: np.ndarray, tile: np.ndarray) -> list[np.ndarray]:
    """Cosine-weighted directions about each normal."""
    helper = np.where(np.abs(normals[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
    first = np.cross(normals, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    made = []
    for sample in range(SAMPLES):
        u, v = _sequence(tile, sample)
        radius, angle = np.sqrt(u)[:, None], 2 * np.pi * v[:, None]
        made.append(radius * (np.cos(angle) * first + np.sin(angle) * second) + np.sqrt(1 - radius**2) * normals)
    return made


def _disc(towards: np.ndarray, radius: float, tile: np.ndarray) -> list[np.ndarray]:
    """Directions to points of a round lamp."""
    first = np.cross(towards, [0.0, 1.0, 0.0] if abs(towards[1]) < 0.9 else [1.0, 0.0, 0.0])
    first /= np.linalg.norm(first)
    second = np.cross(towards, first)
    made = []
    for sample in range(SAMPLES):
        u, v = _sequence(tile, sample)
        away, angle = radius * np.sqrt(u)[:, None], 2 * np.pi * v[:, None]
        made.append(towards + away * (np.cos(angle) * first + np.sin(angle) * second))
    return made


def _open(scene: raycast.RayScene, points: np.ndarray, directions: list[np.ndarray], reach: float) -> np.ndarray:
    """Fraction of the directions that are free within `reach` [m]."""
    free = np.zeros(len(points))
    for way in directions:
        free += ~scene.occluded(np.concatenate([points, way], axis=1), reach)
    return np.asarray(free / len(directions))


def _smoothed(values: np.ndarray, seen: raycast.Render) -> np.ndarray:
    """Average over a tile's neighbourhood, restricted to pixels of similar depth and normal."""
    total, weight = np.zeros_like(values), np.zeros(seen.depth.shape)
    depth = np.where(seen.index >= 0, seen.depth, np.inf)
    for down in range(-2, 3):
        for right in range(-2, 3):
            share = (1.0 if abs(down) < 2 else 0.5) * (1.0 if abs(right) < 2 else 0.5)
            there = (np.roll(a, (down, right), (0, 1)) for a in (values, depth, seen.normal))
            other, far, normal = there
            near = np.abs(far - depth) < 0.02 * np.minimum(depth, 10.0)
            alike = share * (near & ((normal * seen.normal).sum(axis=-1) > 0.85))
            total += alike[..., None] * other
            weight += alike
    return np.asarray(np.where(weight[..., None] > 0, total / np.maximum(weight, 1e-9)[..., None], values))


def _doubled(values: np.ndarray, coarse: np.ndarray, fine: np.ndarray) -> np.ndarray:
    """Values (H, W, C) at twice the resolution, from those of the nine nearest with the fine pixel's depth."""
    row, column = np.mgrid[0 : fine.shape[0], 0 : fine.shape[1]]
    total, weight = np.zeros((*fine.shape, values.shape[-1])), np.zeros(fine.shape)
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            r = np.clip(row // 2 + down, 0, coarse.shape[0] - 1)
            c = np.clip(column // 2 + right, 0, coarse.shape[1] - 1)
            away = (2 * r + 0.5 - row) ** 2 + (2 * c + 0.5 - column) ** 2
            apart = np.abs(coarse[r, c] - fine) / (0.004 * np.maximum(fine, 1e-9))
            share = np.exp(-away / 2.0) / (1.0 + apart**4)
            total += share[..., None] * values[r, c]
            weight += share
    return np.asarray(total / weight[..., None])
