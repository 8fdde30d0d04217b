"""Pinhole projection: OpenCV axes, integer pixel centres, image-plane z."""

from __future__ import annotations

import numpy as np

from dextera_build.errors import ArtifactError
from dextera_build.geometry import transforms

GL_FROM_CV = np.diag([1.0, -1.0, -1.0, 1.0])
"""OpenGL, MuJoCo and USD cameras look along -z with y up; X_gl = GL_FROM_CV @ X_cv."""


def backproject(depth: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Points (H, W, 3) float64 in the camera frame [m] of a (H, W) z-depth [m]; 0 where the depth is 0."""
    rows, columns = np.indices(depth.shape, dtype=np.float64)
    z = depth.astype(np.float64)
    x = (columns - k[0, 2]) / k[0, 0] * z
    y = (rows - k[1, 2]) / k[1, 1] * z
    return np.stack([x, y, z], axis=-1)


def project(points: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Pixels (N, 2) (column, row) of (N, 3) points in the camera frame with z > 0."""
    return np.asarray(points[:, :2] / points[:, 2:] * [k[0, 0], k[1, 1]] + [k[0, 2], k[1, 2]])


def extent(points: np.ndarray, camera_from_world: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Left, top, right and bottom (4,) [px] of the projections of world points (N, 3), those behind the camera too."""
    local = transforms.apply(camera_from_world, points)
    local[:, 2] = np.maximum(local[:, 2], 1e-6)
    pixels = project(local, k)
    return np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])


def rays(height: int, width: int, k: np.ndarray) -> np.ndarray:
    """Directions (H, W, 3) float64 with z = 1, so that a hit's ray parameter is its image-plane depth."""
    return backproject(np.ones((height, width)), k)


def directions(pixels: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Directions (..., 3) with z = 1 of the rays through pixels (..., 2), column and row."""
    places = (pixels - [k[0, 2], k[1, 2]]) / [k[0, 0], k[1, 1]]
    return np.concatenate([places, np.ones((*places.shape[:-1], 1))], axis=-1)


def look_at(eye: np.ndarray, target: np.ndarray) -> np.ndarray:
    """T_world_camera (4, 4) of a camera at `eye` that looks at `target`, (3,) each [m]; image right is horizontal.

    Raises:
        ArtifactError: One is vertically above the other, so image right is not defined.
    """
    forward = np.asarray(target, np.float64) - eye
    right = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 1e-6:
        raise ArtifactError(
            "the camera looks straight up or down, where image right is not defined",
            code="DXB-A204",
            facts={"camera": tuple(map(float, eye)), "target": tuple(map(float, target))},
            hint="move the camera or its target a little",
        )
    forward, right = forward / np.linalg.norm(forward), right / np.linalg.norm(right)
    return transforms.rigid(np.stack([right, np.cross(forward, right), forward], axis=1), np.asarray(eye))


def look_down(target: np.ndarray, distance: float, heading: float, pitch: float, roll: float) -> np.ndarray:
    """T_world_camera (4, 4) of a camera that looks at `target` (3,) [m] from `distance` [m].

    Args:
        target: The point at the principal point of the picture.
        distance: From the optical centre to the target.
        heading: Angle of the horizontal line of sight from +y towards +x [rad].
        pitch: Angle of the line of sight below the horizon, up to pi/2 [rad].
        roll: Rotation of the camera about the line of sight, clockwise as it sees [rad].
    """
    ahead = np.array([np.sin(heading), np.cos(heading), 0.0])
    forward = np.cos(pitch) * ahead - np.array([0.0, 0.0, np.sin(pitch)])
    right = np.array([ahead[1], -ahead[0], 0.0])
    down = np.cross(forward, right)
    c, s = np.cos(roll), np.sin(roll)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return transforms.rigid(np.stack([right, down, forward], axis=1) @ turn, np.asarray(target) - distance * forward)


def nearest_pixels(
    points: np.ndarray, k: np.ndarray, shape: tuple[int, ...], near_m: float = 0.05
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row and column of the pixel nearest to each of `points` (..., 3) in the camera frame, and which are in view.

    Rows and columns (...) are clipped to a picture of `shape` (H, W, ...). Points nearer than `near_m` are not in view.
    """
    ahead = points[..., 2] > near_m
    flat = np.where(ahead[..., None], points, 1.0).reshape(-1, 3)
    pixel = np.round(project(flat, k)).astype(np.int64).reshape(*points.shape[:-1], 2)
    column, row = pixel[..., 0], pixel[..., 1]
    inside = ahead & (pixel >= 0).all(axis=-1) & (column < shape[1]) & (row < shape[0])
    return np.clip(row, 0, shape[0] - 1), np.clip(column, 0, shape[1] - 1), inside
