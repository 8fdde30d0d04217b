"""Other ways to place a mesh of unknown unit: its bounding box, and Open3D's ICP with a free scale."""

from __future__ import annotations

from dextera_build.geometry import kinematics, metrics
from dextera_build.geometry.registration import ScaledPose
from rules.align.object import boxed, starts
from rules.align.object.icp_options import IcpOptions

from .scenes import Known


def bounding_box(known: Known) -> ScaledPose:
    """Boxes along the principal axes of both point sets, laid onto each other by the size of their diagonals."""
    return boxed.principal(boxed.model_points(known.asset), boxed.seen_points(known.seen))


def open3d_icp(known: Known, *, backwards: bool = False, ranked: bool = False) -> ScaledPose:
    """Open3D's point-to-point ICP with scaling; the best fitness is taken, and of equal ones the least RMSE.

    Args:
        known: The view.
        backwards: Register the seen points to the whole model, which is the direction of the smaller set.
        ranked: Start where `align.object` starts, instead of from the 24 axis rotations at the scale of the boxes.
    """
    model, seen = boxed.model_points(known.asset), boxed.seen_points(known.seen)
    begin = _starts(known) if ranked else boxed.upright(model, seen)
    return boxed.sim3_icp(model, seen, begin, backwards=backwards)


def _starts(known: Known) -> list[ScaledPose]:
    vertices, faces = kinematics.posed_surface(known.asset)
    return starts.ranked(metrics.sample_surface(vertices, faces, 200, 0), known.seen, IcpOptions().finalists)
