"""Which faces of a twin the photograph does not show: they were completed, and are marked on request."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import cameras, raycast, transforms

COLOUR = (214, 64, 160)
"""sRGB of the mark."""
LIFT_M = 0.0004
"""The mark lies this far above the surface that it marks [m]."""
_REACHED = 0.999
"""A ray that gets this far towards a face sees it."""


def unseen(
    placed: Sequence[tuple[Mesh, np.ndarray]], camera: Camera, world_from_camera: np.ndarray
) -> list[np.ndarray]:
    """Faces whose middle the camera does not see: it is behind another face, or out of the picture.

    Args:
        placed: Meshes with their poses T_world_mesh (4, 4); they hide one another.
        camera: Intrinsics of the photograph [px].
        world_from_camera: T_world_camera (4, 4), OpenCV axes.

    Returns:
        (F,) bool of each mesh.
    """
    surfaces = [raycast.Surface(transforms.apply(pose, mesh.vertices), mesh.faces) for mesh, pose in placed]
    eye = world_from_camera[:3, 3]
    found = []
    for surface in surfaces:
        middles = surface.vertices[surface.faces].mean(axis=1)
        reach = middles - eye
        hits = raycast.cast(surfaces, np.concatenate([np.broadcast_to(eye, reach.shape), reach], axis=1))
        found.append((hits.depth < _REACHED) | ~_inside(middles, camera, world_from_camera))
    return found


def marked(mesh: Mesh, faces: np.ndarray) -> Mesh:
    """The chosen faces (F,) of a mesh, a little above it, without its texture."""
    corners = mesh.vertices[mesh.faces[faces]].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    lifted = (corners + LIFT_M * normals[:, None]).reshape(-1, 3)
    return Mesh(vertices=lifted.astype(np.float32), faces=np.arange(len(lifted), dtype=np.int32).reshape(-1, 3))


def _inside(points: np.ndarray, camera: Camera, world_from_camera: np.ndarray) -> np.ndarray:
    """Whether points (N, 3) project into the picture."""
    own = transforms.apply(np.linalg.inv(world_from_camera), points)
    ahead = own[:, 2] > 0
    pixels = cameras.project(np.where(ahead[:, None], own, [0.0, 0.0, 1.0]), camera.matrix())
    size = np.array([camera.width, camera.height])
    return np.asarray(ahead & ((pixels >= -0.5) & (pixels <= size - 0.5)).all(axis=1))
