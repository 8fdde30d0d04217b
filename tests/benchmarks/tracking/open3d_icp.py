"""The plain alternative: Open3D's point-to-plane ICP from the last pose to the depth around it, without a gate."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import cameras, metrics, transforms

REACH_M = 0.02
"""Largest distance of a pair [m], Open3D's `max_correspondence_distance`."""
POINTS = 1000
"""Points of the model."""
VOXEL_M = 0.004
"""Edge of the voxels to which the depth is thinned [m]; without that it takes several times as long."""


class Icp:
    """One object, frame after frame.

    Args:
        vertices: (V, 3) of its mesh [m].
        faces: (F, 3).
        start: T_camera_object (4, 4) in the first frame.
        k: (3, 3) intrinsics [px].
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, start: np.ndarray, k: np.ndarray) -> None:
        import open3d as o3d

        self._o3d, self._pose, self._k = o3d, start, k
        points, self._normals = _sampled(vertices.astype(np.float64), faces)
        self._points = points
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
        # Only points on the side of the camera take part: with all of them it is worse.
        place, normals = transforms.apply(self._pose, self._points), self._normals @ self._pose[:3, :3].T
        facing = (place * normals).sum(axis=1) < 0
        model = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(self._points[facing]))
        found = registration.registration_icp(
            model, cloud, REACH_M, self._pose, registration.TransformationEstimationPointToPlane()
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


def _sampled(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) spread over a mesh, and normals (N, 3) of their faces."""
    areas = metrics.face_areas(vertices, faces)
    random = np.random.default_rng(0)
    chosen = random.choice(len(faces), POINTS, p=areas / areas.sum())
    a, b, c = (vertices[faces[chosen, corner]] for corner in range(3))
    root, second = np.sqrt(random.uniform(size=(POINTS, 1))), random.uniform(size=(POINTS, 1))
    normals = np.cross(b - a, c - a)
    return (1 - root) * a + root * (1 - second) * b + root * second * c, normals / np.linalg.norm(
        normals, axis=1, keepdims=True
    )
