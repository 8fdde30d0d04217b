"""Other ways to place a mesh of unknown unit: its bounding box, and Open3D's ICP with a free scale."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.view import Seen
from dextera_build.geometry import cameras, kinematics, metrics, registration, transforms
from dextera_build.geometry.registration import Similarity
from rules.align import starts
from rules.align.icp_options import IcpOptions

from .scenes import Known

POINTS = 1500
"""Points on each side."""


def seen_points(seen: Seen) -> np.ndarray:
    """Measured points (N, 3) of the mask in the world [m]."""
    valid = seen.mask & (seen.depth > 0)
    points = cameras.backproject(seen.depth, seen.camera.matrix())[valid]
    return transforms.apply(seen.world_from_camera, points)[:: max(1, len(points) // POINTS)]


def bounding_box(known: Known) -> Similarity:
    """Boxes along the principal axes of both point sets, laid onto each other by the size of their diagonals."""
    model, seen = _model(known), seen_points(known.seen)
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
    return Similarity(scale, transforms.rigid(turn, its_middle - scale * turn @ own_middle))


def open3d_icp(known: Known, *, backwards: bool = False, ranked: bool = False) -> Similarity:
    """Open3D's point-to-point ICP with scaling; the best fitness is taken, and of equal ones the least RMSE.

    Args:
        known: The view.
        backwards: Register the seen points to the whole model, which is the direction of the smaller set.
        ranked: Start where `align.object` starts, instead of from the 24 axis rotations at the scale of the boxes.
    """
    import open3d as o3d

    model, seen = _model(known), seen_points(known.seen)
    size = float(np.linalg.norm(np.ptp(seen, axis=0)))
    clouds = [o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)) for points in (model, seen)]
    estimation = o3d.pipelines.registration.TransformationEstimationPointToPoint(with_scaling=True)
    criteria = o3d.pipelines.registration.ICPConvergenceCriteria(max_iteration=60)
    ends = []
    for start in _starts(known) if ranked else _boxed(model, seen):
        guess = start.pose.copy()
        guess[:3, :3] *= start.scale
        reach = 0.25 * size
        pair = clouds
        if backwards:
            guess, reach, pair = np.linalg.inv(guess), reach / start.scale, clouds[::-1]
        done = o3d.pipelines.registration.registration_icp(*pair, reach, guess, estimation, criteria)
        ends.append((-done.fitness, done.inlier_rmse, done.transformation))
    best = np.asarray(min(ends, key=lambda end: end[:2])[2])
    if backwards:
        best = np.linalg.inv(best)
    scale = float(np.cbrt(max(np.linalg.det(best[:3, :3]), 1e-30)))
    return Similarity(scale, transforms.rigid(best[:3, :3] / scale, best[:3, 3]))


def _boxed(model: np.ndarray, seen: np.ndarray) -> list[Similarity]:
    """The 24 axis rotations at the scale of the boxes' diagonals, middles upon each other."""
    scale = float(np.linalg.norm(np.ptp(seen, axis=0)) / np.linalg.norm(np.ptp(model, axis=0)))
    own, its = ((points.min(axis=0) + points.max(axis=0)) / 2.0 for points in (model, seen))
    turns = registration.cube_rotations()
    return [Similarity(scale, transforms.rigid(turn, its - scale * turn @ own)) for turn in turns]


def _starts(known: Known) -> list[Similarity]:
    vertices, faces = kinematics.posed_surface(known.asset)
    return starts.ranked(metrics.sample_surface(vertices, faces, 200, 0), known.seen, IcpOptions().finalists)


def _model(known: Known) -> np.ndarray:
    vertices, faces = kinematics.posed_surface(known.asset)
    return metrics.sample_surface(vertices, faces, POINTS, 0)
