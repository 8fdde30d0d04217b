"""background.compose without optimisation: one Gaussian for each point of the views."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from dextera_build.artifacts.cameras.views import Views
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.gaussians.arrays import Gaussians
from dextera_build.gaussians.spherical_harmonics import flat
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(
    summary="a Gaussian for each point of the views, as wide as its pixel",
    profiles=("cpu", "stub"),
    packages=("numpy",),
)

LEAST_M = 1e-6
"""Minimum standard deviation [m]."""


class PointsOptions(Options):
    """Options of backend `points` of background.compose."""

    spread: float = Field(0.4, gt=0.0, le=5.0)
    """Standard deviation in the surface, in distances between neighbouring pixels."""
    thickness: float = Field(0.2, gt=0.0, le=1.0)
    """Standard deviation along the normal over that in the surface."""
    opacity: float = Field(0.99, gt=0.0, le=1.0)
    """Opacity of each Gaussian."""


def compose(ctx: Context, views: Views, background: Background | None, options: PointsOptions) -> Room:
    """Flat Gaussians on the points with view-independent colours; depth is not estimated."""
    points = views.points
    if points is None or not len(points.points):
        ctx.fail("the views carry no points", hint="backend `warp` of background.expand adds them, and COLMAP does")
    if points.colours is None:
        ctx.fail("the points of the views have no colours")
    count = len(points.points)
    across = np.maximum(options.spread * _distances(points), LEAST_M)
    scales = np.stack([across, across, across], axis=1)
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    if points.normals is not None:
        known = np.linalg.norm(points.normals, axis=1) > 0.5
        turns[known] = _upright(points.normals[known].astype(np.float64))
        scales[known, 2] *= options.thickness
    harmonics = flat(points.colours / 255.0)
    made = Gaussians(points.points.astype(np.float64), turns, scales, np.full(count, options.opacity), harmonics)
    return Room(splats=Splats.of(made, points.frame), points=points)


def _distances(points: PointCloud) -> np.ndarray:
    """Distance (N,) [m] of each point from its neighbours: its `footprint`, else the distance to the nearest point."""
    if "footprint" in points.attributes:
        return points.attributes["footprint"].astype(np.float64)
    from scipy.spatial import cKDTree

    places = points.points.astype(np.float64)
    away = np.asarray(cKDTree(places).query(places, k=min(2, len(places)))[0])
    return np.asarray(away.reshape(len(places), -1)[:, -1])


def _upright(normals: np.ndarray) -> np.ndarray:
    """Quaternions (N, 4), w x y z, that rotate z to each of the unit normals (N, 3) or its opposite."""
    up = normals * np.where(normals[:, 2:] < 0, -1.0, 1.0)
    turns = np.stack([1.0 + up[:, 2], -up[:, 1], up[:, 0], np.zeros(len(up))], axis=1)
    return np.asarray(turns / np.linalg.norm(turns, axis=1, keepdims=True))
