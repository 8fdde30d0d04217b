"""Other ways to place a mesh of unknown unit: its bounding box, and Open3D's ICP with a free scale."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.view import Seen
from dextera_build.geometry import cameras, kinematics, metrics, registration, transforms
from dextera_build.geometry.registration import Similarity

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


def open3d_icp(known: Known, *, backwards: bool = False) -> Similarity:
    """Open3D's point-to-point ICP with scaling, from the 24 axis rotations at the scale of the boxes.

    The end with the best fitness is taken, and of equal ones that with the least RMSE.

    Args:
        known: The view.
        backwards: Register the seen points to the whole model, which is the direction of the smaller set.
    """
    import open3d as o3d

    model, seen = _model(known), seen_points(known.seen)
    size = float(np.linalg.norm(np.ptp(seen, axis=0)))
    start = size / float(np.linalg.norm(np.ptp(model, axis=0)))
    target = (model.min(axis=0) + model.max(axis=0)) / 2.0
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2.0
    clouds = [o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)) for points in (model, seen)]
    estimation = o3d.pipelines.registration.TransformationEstimationPointToPoint(with_scaling=True)
    criteria = o3d.pipelines.registration.ICPConvergenceCriteria(max_iteration=60)
    ends = []
    for turn in registration.cube_rotations():
        guess = transforms.rigid(turn * start, middle - start * turn @ target)
        if backwards:
            guess = np.linalg.inv(guess)
        reach = 0.25 * size / (start if backwards else 1.0)
        pair = clouds[::-1] if backwards else clouds
        done = o3d.pipelines.registration.registration_icp(*pair, reach, guess, estimation, criteria)
        ends.append((-done.fitness, done.inlier_rmse, done.transformation))
    best = np.asarray(min(ends, key=lambda end: end[:2])[2])
    if backwards:
        best = np.linalg.inv(best)
    scale = float(np.cbrt(max(np.linalg.det(best[:3, :3]), 1e-30)))
    return Similarity(scale, transforms.rigid(best[:3, :3] / scale, best[:3, 3]))


def _model(known: Known) -> np.ndarray:
    vertices, faces = kinematics.posed_surface(known.asset)
    return metrics.sample_surface(vertices, faces, POINTS, 0)
