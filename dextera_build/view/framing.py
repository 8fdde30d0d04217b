"""Where the view of a single artifact begins: so that all of it is seen."""

from __future__ import annotations

from functools import singledispatch
from typing import Any

import numpy as np

from dextera_build.artifacts.base import Artifact, Collection
from dextera_build.artifacts.objects.object import Asset, Body, Shape
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.geometry import kinematics, transforms
from dextera_build.view.figure import look_from

_CORE = (2.0, 98.0)
"""Percentiles of Gaussians and points that the view holds: a few of them are far away."""
_SOLID = 0.2
"""Gaussians below this opacity are haze."""


def look_at(server: Any, artifact: Artifact) -> None:
    """Begin the view so that an artifact fills it; one without a shape leaves it as it is."""
    points = spread(artifact)
    if len(points):
        look_from(server, points)


@singledispatch
def spread(artifact: Artifact) -> np.ndarray:
    """Points (N, 3) [m] that the view of an artifact has to hold, in the coordinates that it is shown in."""
    return np.zeros((0, 3))


@spread.register
def _(splats: Splats) -> np.ndarray:
    solid = splats.means[splats.opacities >= _SOLID]
    return _core(solid if len(solid) else splats.means)


@spread.register
def _(room: Room) -> np.ndarray:
    return spread(room.splats)


@spread.register
def _(cloud: PointCloud) -> np.ndarray:
    return _core(cloud.points)


@spread.register(Mesh)
@spread.register(Hull)
def _(surface: Mesh | Hull) -> np.ndarray:
    return surface.vertices.astype(np.float64)


@spread.register
def _(background: Background) -> np.ndarray:
    return spread(background.mesh)


@spread.register
def _(shape: Shape) -> np.ndarray:
    points = spread(shape.mesh)
    return points if shape.pose is None else transforms.apply(shape.pose.matrix, points)


@spread.register
def _(body: Body) -> np.ndarray:
    links = kinematics.link_poses(body)
    points = np.concatenate([transforms.apply(pose, body.links[link].mesh.vertices) for link, pose in links.items()])
    return points if body.pose is None else transforms.apply(body.pose.matrix, points)


@spread.register
def _(asset: Asset) -> np.ndarray:
    return spread(asset.body.model_copy(update={"pose": asset.pose}))


@spread.register
def _(collection: Collection) -> np.ndarray:  # type: ignore[type-arg]
    return np.concatenate([np.zeros((0, 3)), *map(spread, collection.items.values())])


def _core(points: np.ndarray) -> np.ndarray:
    """The corners (2, 3) of the box of most points; none of none, and of those that are no numbers."""
    known = points[np.isfinite(points).all(axis=1)].astype(np.float64)
    return np.percentile(known, _CORE, axis=0) if len(known) else np.zeros((0, 3))
