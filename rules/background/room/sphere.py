"""Conversion between pinhole and equirectangular pictures."""

from __future__ import annotations

import cv2
import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.lens import Equirectangular


def level(world_from_camera: np.ndarray) -> np.ndarray:
    """Rotation R_world_panorama (3, 3) with y straight down and z where the camera looks, horizontally.

    A camera that looks straight down or up has the top or the bottom of its picture ahead.

    Args:
        world_from_camera: (4, 4) T_world_camera, world z up.
    """
    ahead = world_from_camera[:3, 2] * [1.0, 1.0, 0.0]
    if np.linalg.norm(ahead) < 1e-6:
        ahead = world_from_camera[:3, 1] * [1.0, 1.0, 0.0] * np.sign(world_from_camera[2, 2])
    ahead = ahead / np.linalg.norm(ahead)
    down = np.array([0.0, 0.0, -1.0])
    return np.stack([np.cross(down, ahead), down, ahead], axis=1)


def warped(
    pixels: np.ndarray, camera: Camera, camera_from_panorama: np.ndarray, height: int
) -> tuple[np.ndarray, np.ndarray]:
    """Project a photograph into the panorama at the same position.

    Args:
        pixels: (h, w, 3) uint8, of the camera's size.
        camera: Intrinsics [px].
        camera_from_panorama: (3, 3) rotation.
        height: Rows of the panorama; it has twice as many columns.

    Returns:
        The panorama (height, 2 height, 3) uint8, and the pixels of it (height, 2 height) that the photograph shows.
    """
    lens = Equirectangular(width=2 * height, height=height)
    rows, columns = np.indices((height, 2 * height), dtype=np.float64)
    rays = lens.unproject(np.stack([columns.ravel(), rows.ravel()], axis=1)) @ camera_from_panorama.T
    places = camera.project(rays).reshape(height, 2 * height, 2)
    with np.errstate(invalid="ignore"):
        inside = (places >= -0.5) & (places < np.array([camera.width - 0.5, camera.height - 0.5]))
    seen = np.asarray(inside.all(axis=-1))
    # A pixel of the panorama covers several of the photograph, which are averaged.
    covered = max(camera.fx * np.pi / height, 1.0)
    soft = cv2.GaussianBlur(pixels, (0, 0), 0.5 * covered) if covered > 1.2 else pixels
    maps = np.where(seen[..., None], places, 0.0).astype(np.float32)
    picture = cv2.remap(soft, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.where(seen[..., None], picture, 0).astype(np.uint8), seen


def sampled(panorama: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Colours (h, w, 3) uint8 that a panorama (H, 2 H, 3) shows in directions (h, w, 3) of its own frame, not 0."""
    height, width = panorama.shape[:2]
    lens = Equirectangular(width=width, height=height)
    places = lens.project(directions.reshape(-1, 3)).reshape(*directions.shape[:2], 2) + 1.0
    closed = np.pad(np.pad(panorama, ((0, 0), (1, 1), (0, 0)), mode="wrap"), ((1, 1), (0, 0), (0, 0)), mode="edge")
    maps = places.astype(np.float32)
    return np.asarray(cv2.remap(closed, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR))
