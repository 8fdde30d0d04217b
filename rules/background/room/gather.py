"""Merging of points from several cameras, each surface from the first camera that sees it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.geometry import cameras, transforms

SAME_DEPTH = 0.02
"""Largest relative depth difference to an earlier camera at which a point belongs to a surface seen before."""


@dataclass(frozen=True)
class Look:
    """The surface at each pixel of one camera."""

    pose: np.ndarray  # (4, 4) T_world_camera
    pixels: np.ndarray  # (H, W, 3) uint8 sRGB
    depth: np.ndarray  # (H, W) float64, image-plane z [m], above 0
    normal: np.ndarray  # (H, W, 3) float64, unit, world frame
    measured: np.ndarray  # (H, W) bool, a measured surface


def together(looks: list[Look], camera: Camera) -> PointCloud:
    """The points in frame `world` [m], in the order of the looks, with colours, normals and two attributes.

    `footprint` is the distance [m] that one pixel spans at the depth of a point, `measured` is 1 on measured surfaces.
    """
    parts: list[tuple[np.ndarray, ...]] = []
    for number, look in enumerate(looks):
        points = transforms.apply(look.pose, cameras.backproject(look.depth, camera.matrix())).reshape(-1, 3)
        fresh = np.arange(len(points))
        for earlier in looks[:number]:
            fresh = fresh[~_shown(points[fresh], earlier, camera)]
        normal = look.normal.reshape(-1, 3)[fresh]
        away = ((points[fresh] - look.pose[:3, 3]) * normal).sum(axis=1) > 0
        parts.append(
            (
                points[fresh],
                look.pixels.reshape(-1, 3)[fresh],
                np.where(away[:, None], -normal, normal),
                look.depth.reshape(-1)[fresh] / camera.fx,
                look.measured.reshape(-1)[fresh],
            )
        )
    points, colours, normals, footprint, measured = map(np.concatenate, zip(*parts, strict=True))
    return PointCloud(
        points=points.astype(np.float32),
        colours=colours.astype(np.uint8),
        normals=normals.astype(np.float32),
        attributes={"footprint": footprint.astype(np.float32), "measured": measured.astype(np.float32)},
        frame="world",
    )


def _shown(points: np.ndarray, look: Look, camera: Camera) -> np.ndarray:
    """Whether a look shows each of the points (N, 3)."""
    local = transforms.apply(transforms.invert(look.pose), points)
    places = np.round(np.nan_to_num(camera.project(local), nan=-1.0))
    inside = ((places >= 0) & (places < [camera.width, camera.height])).all(axis=1)
    column, row = np.where(inside[:, None], places, 0).astype(int).T
    depth = look.depth[row, column]
    return np.asarray(inside & (np.abs(local[:, 2] - depth) <= SAME_DEPTH * depth))
