"""background.expand in one colour: every camera sees the mean of the panorama."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.panorama import Panorama
from dextera_build.artifacts.cameras.views import Views, encoded
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.artifacts.spatial.trajectory import Trajectory
from dextera_build.rule import Backend, Context, Options

from .cameras import ordered

BACKEND = Backend(summary="one colour for every view, the corners of the surface as points", profiles=("stub",))

FOOTPRINT_M = 0.05
"""Stated distance between points [m]."""


def expand(
    ctx: Context,
    panorama: Panorama,
    paths: Collection[Trajectory],
    background: Background,
    camera: Camera,
    options: Options,
) -> Views:
    """Pictures of one colour along the paths."""
    colour = panorama.image.pixels.mean(axis=(0, 1)).round().astype(np.uint8)
    image = encoded(np.broadcast_to(colour, (camera.height, camera.width, 3)).copy())
    cameras = ordered(paths, panorama.pose.matrix[:3, 3])
    corners = background.mesh.vertices[:1000]
    points = PointCloud(
        points=corners,
        colours=np.broadcast_to(colour, corners.shape).copy(),
        attributes={"footprint": np.full(len(corners), FOOTPRINT_M, np.float32)},
        frame="world",
    )
    return Views(
        images=dict.fromkeys(cameras, image),
        names=tuple(cameras),
        camera=("1",) * len(cameras),
        cameras={"1": camera},
        poses=np.array(list(cameras.values())),
        points=points,
    )
