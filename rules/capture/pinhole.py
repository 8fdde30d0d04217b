"""Rectification of pictures with lens distortion to a pinhole camera of the same focal length."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.lens import BrownConrady, KannalaBrandt
from dextera_build.geometry import cameras

Lens = BrownConrady | KannalaBrandt


def distorted(camera: Camera, coefficients: Sequence[float]) -> BrownConrady:
    """The camera with distortion: 4, 5 or 8 coefficients in OpenCV's order, k1 k2 p1 p2 k3 k4 k5 k6."""
    names = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    return BrownConrady(**camera.model_dump(), **dict(zip(names, coefficients, strict=False)))


def pinhole(lens: Lens) -> Camera:
    """The camera without the distortion."""
    return Camera(width=lens.width, height=lens.height, fx=lens.fx, fy=lens.fy, cx=lens.cx, cy=lens.cy)


def places(lens: Lens) -> np.ndarray:
    """Position of each pixel of the pinhole camera in the distorted picture, (H, W, 2) column, row; NaN if outside."""
    camera = pinhole(lens)
    rays = cameras.rays(camera.height, camera.width, camera.matrix())
    found = lens.project(rays.reshape(-1, 3)).reshape(camera.height, camera.width, 2)
    inside = np.all((found >= -0.5) & (found <= np.array([camera.width, camera.height]) - 0.5), axis=-1, keepdims=True)
    return np.where(inside, found, np.nan)


def smooth(pixels: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Bilinear samples of (H, W, C) uint8 at `where`; black outside."""
    limit = np.array([pixels.shape[1] - 1, pixels.shape[0] - 1])
    place = np.clip(np.nan_to_num(where), 0, limit)
    low = np.minimum(place.astype(np.int64), np.maximum(limit - 1, 0))
    high, part = np.minimum(low + 1, limit), place - low
    (x0, y0), (x1, y1), (u, v) = (np.moveaxis(each, -1, 0) for each in (low, high, part))
    u, v = u[..., None], v[..., None]
    above = pixels[y0, x0] * (1 - u) + pixels[y0, x1] * u
    below = pixels[y1, x0] * (1 - u) + pixels[y1, x1] * u
    mixed = np.round(above * (1 - v) + below * v).astype(np.uint8)
    return np.where(np.isnan(where[..., :1]), np.uint8(0), mixed)


def nearest(depth: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Nearest samples of (H, W) depth at `where`; 0 outside. Image-plane z is not affected by distortion."""
    column, row = np.moveaxis(np.round(np.nan_to_num(where)).astype(np.int64), -1, 0)
    found = depth[np.clip(row, 0, depth.shape[0] - 1), np.clip(column, 0, depth.shape[1] - 1)]
    return np.where(np.isnan(where[..., 0]), np.float32(0.0), found)
