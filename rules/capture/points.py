"""capture.points: a point cloud from a PLY file."""

from __future__ import annotations

from dextera_build.artifacts.base import File
from dextera_build.artifacts.point_cloud import PointCloud
from dextera_build.rule import Context, Options, rule


class PointsOptions(Options):
    """Options of capture.points."""

    frame: str = ""
    """Frame of the coordinates; "": as in a comment `frame NAME` of the file."""


@rule(version=1, packages=("numpy",))
def points(ctx: Context, file: File, *, options: PointsOptions) -> PointCloud:
    """Return the points of a PLY file, binary or ASCII [m], with colours, normals and other properties."""
    path = ctx.scratch / "points.ply"
    file.place(path)
    cloud = PointCloud.load(path, frame=options.frame or None)
    ctx.metric("points", len(cloud.points))
    ctx.say(", ".join(cloud.facts()))
    return cloud
