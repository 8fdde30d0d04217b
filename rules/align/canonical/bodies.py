"""The surface of a body, for rays, distances and colours."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.objects.object import Body
from dextera_build.geometry.raycast import RayScene


class Surface:
    """All links of a body as posed.

    Args:
        body: Its links' textures.
        vertices: (V, 3), links by name.
        faces: (F, 3) int.
    """

    def __init__(self, body: Body, vertices: np.ndarray, faces: np.ndarray) -> None:
        self._body, self.vertices, self.faces = body, vertices, faces
        self._scene = RayScene((vertices, faces))

    def distances(self, points: np.ndarray) -> np.ndarray:
        """Distance (N,) of points (N, 3) to the surface."""
        return self._scene.distances(points).astype(np.float64)

    def cast(self, rays: np.ndarray) -> np.ndarray:
        """Distances (...) along rays (..., 6), inf without a hit."""
        return self._scene.cast(rays).distance.astype(np.float64)

    def paint(self, faces: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """SRGB (N, 3), 0..1, of points on faces (N,) at barycentric weights (N, 3)."""
        return paint(self._body, faces, weights)


def paint(body: Body, faces: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """SRGB (N, 3), 0..1, of points on the body's faces (N,), links by name, at barycentric weights (N, 3)."""
    found, first = np.zeros((len(faces), 3)), 0
    for name in sorted(body.links):
        mesh = body.links[name].mesh
        own = (faces >= first) & (faces < first + len(mesh.faces))
        found[own] = mesh.paint(faces[own] - first, weights[own])
        first += len(mesh.faces)
    return found
