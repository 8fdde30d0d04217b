"""A baseline: screened Poisson reconstruction of the seen points by Open3D, cut at their convex hull."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import PositiveInt

from dextera_build.artifacts.objects.object import Shape
from dextera_build.artifacts.objects.view import ObjectView, Seen
from dextera_build.geometry import open3d_core, repair, solids
from dextera_build.geometry.solids import Solid
from dextera_build.rule import Backend, Context, Options

from ..measured import Measurements
from . import baseline
from .evidence import Evidence
from .mesh_convex_hull import hull

if TYPE_CHECKING:
    from .mesh import MeshOptions

BACKEND = Backend(
    summary="a baseline: Open3D's screened Poisson reconstruction of the seen points, down to the support",
    packages=("open3d", "opencv-python-headless", "scipy", "manifold3d"),
    extra="twin",
)

ROOM = 2.0
"""Edge of the octree relative to that of the points' bounding cube; the surface is open where it leaves the octree."""
LONGEST_HOLE = 100
"""Maximum number of edges of a hole that is closed."""
UNDERSIDE_M = 0.004
"""Spacing of the points of the underside [m]."""


class PoissonOptions(Options):
    """Options of backend `poisson` of factorize.mesh."""

    depth: PositiveInt = 8
    """Depth of the octree."""


def complete(
    ctx: Context, view: ObjectView, measured: Measurements[Seen], common: MeshOptions, options: PoissonOptions
) -> Shape:
    """Return the surface through the seen points and their projections onto the support, which form the underside."""
    return baseline.shape_of(ctx, "poisson", measured, common, lambda evidence: _surface(ctx, evidence, options.depth))


def _surface(ctx: Context, evidence: Evidence, depth: int) -> Solid:
    o3d = open3d_core.loaded()

    points, normals = evidence.points, evidence.normals
    known = np.linalg.norm(normals, axis=1) > 0.5
    points, normals = points[known], normals[known]
    cells = np.unique(np.round(points[:, :2] / UNDERSIDE_M).astype(int), axis=0) * UNDERSIDE_M
    feet = np.c_[cells, np.zeros(len(cells))]
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.concatenate([points, feet])))
    down = np.broadcast_to([0.0, 0.0, -1.0], feet.shape)
    cloud.normals = o3d.utility.Vector3dVector(np.concatenate([normals, down]))
    # One thread, because the order of summation changes the surface.
    mesh, _ = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=depth, scale=ROOM, n_threads=1)
    closed = repair.repaired(np.asarray(mesh.vertices), np.asarray(mesh.triangles), None, LONGEST_HOLE)
    inside = solids.intersection(Solid(closed.vertices, closed.faces.astype(np.int64)), hull(evidence))
    if not len(inside.faces):
        ctx.fail("the Poisson surface is open", hint="lower `depth`")
    return solids.largest(inside)
