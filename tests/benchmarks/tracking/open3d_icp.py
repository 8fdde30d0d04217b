"""The plain alternative: Open3D's point-to-plane ICP from the last pose to the depth around it, without a gate."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import cameras, transforms

REACH_M = 0.02
"""Largest distance of a pair [m], Open3D's `max_correspondence_distance`."""
VOXEL_M = 0.004
"""Edge of the voxels to which the depth is thinned [m]; without that it takes several times as long."""


class Icp:
    """One object, frame after frame.

    Args:
        points: (N, 3) of its surface [m].
        start: T_camera_object (4, 4) in the first frame.
        k: (3, 3) intrinsics [px].
    """

    def __init__(self, points: np.ndarray, start: np.ndarray, k: np.ndarray) -> None:
        import open3d as o3d

        self._o3d, self._pose, self._k = o3d, start, k
        self._model = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
        self._centre = (points.min(axis=0) + points.max(axis=0)) / 2
        self._radius = float(np.linalg.norm(points - self._centre, axis=1).max())

    def step(self, depth: np.ndarray) -> np.ndarray:
        """T_camera_object (4, 4) in the next frame."""
        o3d = self._o3d
        seen = self._around(depth)
        if len(seen) < 50:
            return self._pose
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(seen)).voxel_down_sample(VOXEL_M)
        cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(20))
        registration = o3d.pipelines.registration
        found = registration.registration_icp(
            self._model, cloud, REACH_M, self._pose, registration.TransformationEstimationPointToPlane()
        )
        self._pose = np.array(found.transformation)
        return self._pose

    def _around(self, depth: np.ndarray) -> np.ndarray:
        """Measured points (N, 3) near the last pose."""
        middle = transforms.apply(self._pose, self._centre[None])
        reach = (self._radius + REACH_M) * self._k[0, 0] / max(float(middle[0, 2]), 0.1)
        column, row = cameras.project(middle, self._k)[0] if middle[0, 2] > 0 else (-1e6, -1e6)
        top, bottom = (int(np.clip(row + side, 0, depth.shape[0])) for side in (-reach, reach))
        left, right = (int(np.clip(column + side, 0, depth.shape[1])) for side in (-reach, reach))
        crop = depth[top:bottom, left:right]
        moved = self._k - np.array([[0, 0, left], [0, 0, top], [0, 0, 0]])
        points = cameras.backproject(crop, moved)[crop > 0]
        return np.asarray(points[np.linalg.norm(points - middle, axis=1) < self._radius + REACH_M])
