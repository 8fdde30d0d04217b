"""Visibility of another view in a capture, and two baselines that render the view from the capture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import cameras, raycast, transforms


@dataclass(frozen=True)
class Own:
    """The capture from which a twin was made."""

    rgb: np.ndarray  # (H, W, 3) uint8
    depth: np.ndarray  # (H, W) [m]; 0 if invalid
    objects: np.ndarray  # (H, W) bool, pixels of objects
    k: np.ndarray  # (3, 3) intrinsics [px]


def seen(own: Own, depth: np.ndarray, own_from_other: np.ndarray, apart_m: float) -> np.ndarray:
    """Pixels (H, W) of another view whose measured surface is also measured in the capture, within `apart_m`."""
    points = transforms.apply(own_from_other, cameras.backproject(depth, own.k))
    row, column, inside = cameras.nearest_pixels(points, own.k, own.depth.shape)
    measured = own.depth[row, column]
    near = np.abs(measured - points[..., 2]) < apart_m
    return np.asarray((depth > 0) & inside & (measured > 0) & near)


def objects(own: Own, depth: np.ndarray, own_from_other: np.ndarray, reach_px: int) -> np.ndarray:
    """Pixels (H, W) of another view that show an object of the capture, or are within `reach_px` of one."""
    points = transforms.apply(own_from_other, cameras.backproject(depth, own.k))
    row, column, inside = cameras.nearest_pixels(points, own.k, own.depth.shape)
    there = (depth > 0) & inside & own.objects[row, column]
    return dilated(there, reach_px)


def dilated(mask: np.ndarray, reach_px: int) -> np.ndarray:
    """A mask (H, W) with all pixels within `reach_px` of it."""
    from scipy.ndimage import binary_dilation

    return np.asarray(binary_dilation(mask, iterations=reach_px)) if reach_px else mask


def splat(own: Own, other_from_own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The capture's measured pixels as points of one pixel: colours (H, W, 3) uint8 and depth (H, W) [m]."""
    valid = own.depth > 0
    points = transforms.apply(other_from_own, cameras.backproject(own.depth, own.k)[valid])
    row, column, inside = cameras.nearest_pixels(points, own.k, own.depth.shape)
    order = np.flatnonzero(inside)
    order = order[np.argsort(-points[order, 2], kind="stable")]
    rgb, depth = np.zeros_like(own.rgb), np.zeros(own.depth.shape)
    rgb[row[order], column[order]] = own.rgb[valid][order]
    depth[row[order], column[order]] = points[order, 2]
    return rgb, depth


def sheet(own: Own) -> raycast.Surface:
    """All measured pixels as one mesh without cuts, in the capture's camera frame."""
    height, width = own.depth.shape
    index = np.arange(height * width).reshape(height, width)
    corners = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
    whole = (own.depth.reshape(-1)[corners] > 0).all(axis=1)
    faces = np.concatenate([corners[whole][:, [0, 1, 3]], corners[whole][:, [1, 2, 3]]])
    rows, columns = np.indices((height, width))
    uv = np.stack([(columns + 0.5) / width, 1.0 - (rows + 0.5) / height], axis=-1).reshape(-1, 2)
    return raycast.Surface(cameras.backproject(own.depth, own.k).reshape(-1, 3), faces, uv[faces], own.rgb)
