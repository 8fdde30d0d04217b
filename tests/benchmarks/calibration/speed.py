"""Balanced ICP beside Open3D's at 100k points and 5 poses, in one run: `tests.benchmarks.calibration.speed`."""

from __future__ import annotations

import time

import numpy as np
import open3d as o3d

from dextera_build.geometry import balanced_icp
from tests.geometry.toy_robots import Faults, Scene, capture

POINTS = 100_000


def scene(seed: int) -> Scene:
    """Five poses with about `POINTS` measured points."""
    return capture(seed, 5, faults=Faults(shape_scale=1.02), size=0.3, hand_points=950)


def open3d(each: Scene) -> np.ndarray:
    """DT by point-to-plane ICP of Open3D on all points of all poses, each pose away from the others.

    One registration of all poses is what Open3D offers; poses are told apart by an offset that no pair bridges, so the
    rotation is linear in it, too: so poses are registered one after the other, and their corrections averaged.
    """
    motions = []
    for pose in each.poses:
        model, seen = o3d.geometry.PointCloud(), o3d.geometry.PointCloud()
        model.points = o3d.utility.Vector3dVector(np.concatenate([part.model for part in pose.values()]))
        seen.points = o3d.utility.Vector3dVector(np.concatenate([part.seen for part in pose.values()]))
        seen.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(0.02, 20))
        found = o3d.pipelines.registration.registration_icp(
            model,
            seen,
            0.05,
            np.eye(4),
            o3d.pipelines.registration.TransformationEstimationPointToPlane(),
            o3d.pipelines.registration.ICPConvergenceCriteria(max_iteration=balanced_icp.ITERATIONS),
        )
        motions.append(found.transformation)
    from dextera_build.geometry.hand_eye import mean_pose

    return mean_pose(motions)


if __name__ == "__main__":
    rows = []
    for seed in range(5):
        each = scene(seed)
        count = sum(len(part.seen) + len(part.model) for pose in each.poses for part in pose.values())
        began = time.process_time()
        theirs = open3d(each)
        middle = time.process_time()
        found = balanced_icp.correct(each.poses).motion
        ended = time.process_time()
        errors = 1000 * each.hand_error(theirs), 1000 * each.hand_error(found)
        rows.append((middle - began, ended - middle, *errors))
        print(f"{count} points: Open3D {rows[-1][0]:.2f} s, {errors[0]:.2f} mm;", end=" ")
        print(f"ours {rows[-1][1]:.2f} s, {errors[1]:.2f} mm")
    table = np.array(rows)
    ratio, *hands = np.median(table[:, 0] / table[:, 1]), np.median(table[:, 2]), np.median(table[:, 3])
    print(f"median ratio {ratio:.1f}, hand {hands[0]:.2f} and {hands[1]:.2f} mm")
