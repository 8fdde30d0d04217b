"""The surface of a body, for rays, distances and colours."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.object import Body


class Surface:
    """All links of a body as posed.

    Args:
        body: Its links' textures.
        vertices: (V, 3), links by name.
        faces: (F, 3) int.
    """

    def __init__(self, body: Body, vertices: np.ndarray, faces: np.ndarray) -> None:
        import open3d as o3d

        self._body, self.vertices, self.faces = body, vertices, faces
        self._tensor = o3d.core.Tensor
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        self._scene.add_triangles(
            o3d.core.Tensor(np.ascontiguousarray(vertices, np.float32)),
            o3d.core.Tensor(np.ascontiguousarray(faces, np.uint32)),
        )

    def distances(self, points: np.ndarray) -> np.ndarray:
        """Distance (N,) of points (N, 3) to the surface."""
        found = self._scene.compute_distance(self._tensor(np.ascontiguousarray(points, np.float32)))
        return np.asarray(found.numpy(), np.float64)

    def cast(self, rays: np.ndarray) -> np.ndarray:
        """Distances (...) along rays (..., 6), inf without a hit."""
        found = self._scene.cast_rays(self._tensor(np.ascontiguousarray(rays, np.float32)))
        return np.asarray(found["t_hit"].numpy(), np.float64)

    def paint(self, faces: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """SRGB (N, 3), 0..1, of points on faces (N,) at barycentric weights (N, 3)."""
        found, first = np.zeros((len(faces), 3)), 0
        for name in sorted(self._body.links):
            mesh = self._body.links[name].mesh
            own = (faces >= first) & (faces < first + len(mesh.faces))
            found[own] = mesh.paint(faces[own] - first, weights[own])
            first += len(mesh.faces)
        return found
