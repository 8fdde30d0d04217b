"""Points and Gaussians from their front left and above."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.cameras.image import png
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.gaussians import splatting
from dextera_build.gaussians.spherical_harmonics import COUNTS
from dextera_build.geometry.thumbnail import scatter

_GREY = 0.45


def _facts_of_point_cloud(cloud: PointCloud) -> Iterator[str]:
    """Number of points, extent, and available properties."""
    yield f"{len(cloud.points):,} points"
    if len(cloud.points):
        yield " x ".join(f"{1000 * length:.0f}" for length in np.ptp(cloud.points, axis=0)) + " mm"
    yield from (name for name in ("colours", "normals") if getattr(cloud, name) is not None)
    yield from cloud.attributes
    if cloud.frame:
        yield f"frame {cloud.frame}"


def _picture_of_point_cloud(cloud: PointCloud) -> bytes:
    """The points from their front left and above."""
    grey = np.full((len(cloud.points), 3), _GREY)
    return png(scatter(cloud.points, grey if cloud.colours is None else cloud.colours / 255))


def _facts_of_splats(splats: Splats) -> Iterator[str]:
    """Number of Gaussians, extent, degree of the colours, and the frame."""
    yield f"{len(splats.means):,} Gaussians"
    if len(splats.means):
        yield " x ".join(f"{1000 * length:.0f}" for length in np.ptp(splats.means, axis=0)) + " mm"
    yield f"degree {COUNTS.index(splats.harmonics.shape[1])}"
    if splats.frame:
        yield f"frame {splats.frame}"


def _picture_of_splats(splats: Splats) -> bytes:
    """The Gaussians from their front left and above."""
    return png(splatting.preview(splats.gaussians))


def _facts_of_room(room: Room) -> Iterator[str]:
    """Numbers of Gaussians, points and depth images, and the frame."""
    yield f"{len(room.splats.means):,} Gaussians"
    yield f"{len(room.points.points):,} points"
    if room.depth:
        yield f"depth of {len(room.depth)} views"
    yield f"frame {room.splats.frame}"
    yield room.asset_source


def _picture_of_room(room: Room) -> bytes:
    """The Gaussians from their front left and above."""
    return _picture_of_splats(room.splats)


FACTS: Mapping[type[Artifact], Callable[[Any], Iterator[str]]] = {
    PointCloud: _facts_of_point_cloud,
    Splats: _facts_of_splats,
    Room: _facts_of_room,
}
PICTURES: Mapping[type[Artifact], Callable[[Any], bytes]] = {
    PointCloud: _picture_of_point_cloud,
    Splats: _picture_of_splats,
    Room: _picture_of_room,
}
