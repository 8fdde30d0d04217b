"""Shared code of the baselines of align.object: measured points, points of the model, and scoring."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dextera_build.artifacts.objects.object import Body, Placement
from dextera_build.artifacts.objects.view import Seen
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import RuleError
from dextera_build.geometry import kinematics, metrics, open3d_core, registration, transforms
from dextera_build.geometry.registration import ScaledPose

from . import model_view
from .placed import Placed

POINTS = 1500
"""Points on each side."""


def seen_points(seen: Seen) -> np.ndarray:
    """Measured points (N, 3) of the mask in the world [m].

    Raises:
        RuleError: Nothing was measured.
    """
    points = model_view.seen_points(seen, POINTS)
    if not len(points):
        raise RuleError("nothing of the object was measured", hint="use backend `icp`, which places by silhouette")
    return points


def model_points(body: Body) -> np.ndarray:
    """Points (N, 3) on the body's surface, in its units."""
    return metrics.sample_surface(*kinematics.posed_surface(body), POINTS, 0)


def principal(model: np.ndarray, seen: np.ndarray) -> ScaledPose:
    """Align the boxes along the principal axes of both point sets; the scale is the ratio of their diagonals."""
    boxes = []
    for points in (model, seen):
        middle = points.mean(axis=0)
        axes = np.linalg.eigh(np.cov((points - middle).T))[1]
        axes *= np.sign(np.linalg.det(axes))
        local = (points - middle) @ axes
        low, high = local.min(axis=0), local.max(axis=0)
        boxes.append((axes, middle + axes @ ((low + high) / 2.0), float(np.linalg.norm(high - low))))
    (own, own_middle, own_size), (its, its_middle, its_size) = boxes
    scale, turn = its_size / own_size, its @ own.T
    return ScaledPose(scale, transforms.rigid(turn, its_middle - scale * turn @ own_middle))


def upright(model: np.ndarray, seen: np.ndarray) -> list[ScaledPose]:
    """The 24 axis-aligned rotations at the scale of the boxes' diagonals, with coincident centres."""
    scale = float(np.linalg.norm(np.ptp(seen, axis=0)) / np.linalg.norm(np.ptp(model, axis=0)))
    own, its = ((points.min(axis=0) + points.max(axis=0)) / 2.0 for points in (model, seen))
    turns = registration.cube_rotations()
    return [ScaledPose(scale, transforms.rigid(turn, its - scale * turn @ own)) for turn in turns]


def sim3_icp(
    model: np.ndarray, seen: np.ndarray, starts: Sequence[ScaledPose], *, backwards: bool = False
) -> ScaledPose:
    """Open3D's point-to-point ICP with scaling; returns the best fitness, and among equal ones the lowest RMSE.

    Results whose scale changed by a factor of ten or more are discarded.

    Args:
        model: (N, 3) points of the whole model, in its units.
        seen: (M, 3) measured points [m].
        starts: Initial similarities.
        backwards: Register the seen points to the whole model, instead of the model to the seen points.
    """
    o3d = open3d_core.loaded()

    size = float(np.linalg.norm(np.ptp(seen, axis=0)))
    clouds = [o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)) for points in (model, seen)]
    estimation = o3d.pipelines.registration.TransformationEstimationPointToPoint(with_scaling=True)
    criteria = o3d.pipelines.registration.ICPConvergenceCriteria(max_iteration=60)
    ends: list[tuple[float, float, ScaledPose]] = []
    for start in starts:
        guess = start.pose.copy()
        guess[:3, :3] *= start.scale
        reach, pair = 0.25 * size, clouds
        if backwards:
            guess, reach, pair = np.linalg.inv(guess), reach / start.scale, clouds[::-1]
        done = o3d.pipelines.registration.registration_icp(*pair, reach, guess, estimation, criteria)
        found = _similarity(np.asarray(done.transformation), backwards=backwards)
        # With few correspondences the scale diverges.
        if found is not None and 0.1 < found.scale / start.scale < 10.0:
            ends.append((-done.fitness, done.inlier_rmse, found))
    return min(ends, key=lambda end: end[:2])[2] if ends else starts[0]


def _similarity(matrix: np.ndarray, *, backwards: bool) -> ScaledPose | None:
    """The similarity of a (4, 4) matrix or of its inverse; None if it collapsed."""
    if not np.isfinite(matrix).all() or np.linalg.det(matrix[:3, :3]) < 1e-30:
        return None
    found = np.linalg.inv(matrix) if backwards else np.asarray(matrix)
    scale = float(np.cbrt(np.linalg.det(found[:3, :3])))
    return ScaledPose(scale, transforms.rigid(found[:3, :3] / scale, found[:3, 3]))


def judged(body: Body, seen: Seen, found: ScaledPose, method: str) -> Placed:
    """The placement of a baseline, which has no uncertainty, and how its render agrees with the view."""
    vertices, faces = kinematics.posed_surface(body)
    score = model_view.ModelView(vertices, faces, seen).score(found)
    pose = Pose(parent="world", child="object", matrix=found.pose)
    placement = Placement(pose=pose, scale=found.scale, method=method)
    return Placed(placement, score.iou, score.violation, float(found.apply(vertices)[:, 2].min()))
