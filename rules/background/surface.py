"""A textured triangle surface from the cleaned photograph and depth."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.geometry import Mesh
from dextera_build.artifacts.image import Image
from dextera_build.geometry import cameras, transforms


def plane_depth(camera: Camera, world_from_camera: np.ndarray) -> np.ndarray:
    """Depth (H, W) [m] at which each pixel's ray meets z = 0 of the world; infinite without an intersection."""
    rays = cameras.rays(camera.height, camera.width, camera.matrix())
    down = rays @ world_from_camera[2, :3]
    with np.errstate(divide="ignore"):
        depth = -world_from_camera[2, 3] / down
    return np.where((down < -1e-9) & (depth > 0), depth, np.inf)


def grid_mesh(
    image: np.ndarray,
    depth: np.ndarray,
    camera: Camera,
    world_from_camera: np.ndarray,
    *,
    stride: int,
    edge: float,
    flat: np.ndarray | None = None,
) -> Mesh:
    """Triangulate the depth on a pixel grid, cut at depth steps, in the world frame.

    A cell cut by a step is closed on its far side: the far surface continues under the near one, so the capturing
    camera sees no gap.

    Args:
        image: (H, W, 3) uint8 texture.
        depth: (H, W) image-plane z [m]; 0 omits the surface.
        camera: Intrinsics [px].
        world_from_camera: (4, 4) T_world_camera.
        stride: Spacing of the grid [px].
        edge: Relative depth step at which the mesh is cut.
        flat: (H, W) pixels of one plane, which is never cut, even at grazing angles.
    """
    rows, columns = _marks(camera.height, stride), _marks(camera.width, stride)
    z = depth[np.ix_(rows, columns)].astype(np.float64)
    corners = np.stack([z[:-1, :-1], z[:-1, 1:], z[1:, 1:], z[1:, :-1]], axis=-1).reshape(-1, 4)
    whole = (corners > 0).all(axis=1)
    cut = whole & (corners.max(axis=1) > (1.0 + edge) * corners.min(axis=1))
    if flat is not None:
        even = flat[np.ix_(rows, columns)]
        cut &= ~(even[:-1, :-1] & even[:-1, 1:] & even[1:, 1:] & even[1:, :-1]).reshape(-1)
    index = np.arange(z.size).reshape(z.shape)
    cells = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1).reshape(-1, 4)
    pixel = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2).astype(np.float64)
    far = corners[cut]
    near = far < far.max(axis=1, keepdims=True) / (1.0 + edge)
    level = (far * ~near).sum(axis=1) / (~near).sum(axis=1)
    pushed = np.where(near, level[:, None], far)
    extra = np.arange(pushed.size).reshape(pushed.shape) + z.size
    quads = np.concatenate([cells[whole & ~cut], extra])
    pixels = np.concatenate([pixel, pixel[cells[cut]].reshape(-1, 2)])
    depths = np.concatenate([z.reshape(-1), pushed.reshape(-1)])
    # Image rows increase downwards, so this order is counter-clockwise for the camera.
    faces = np.concatenate([quads[:, [0, 3, 1]], quads[:, [1, 3, 2]]])
    used, faces = np.unique(faces, return_inverse=True)
    faces = faces.reshape(-1, 3)
    vertices = _world(pixels[used], depths[used], camera, world_from_camera)
    uv = np.stack([(pixels[used, 0] + 0.5) / camera.width, 1.0 - (pixels[used, 1] + 0.5) / camera.height], axis=1)
    return Mesh(
        vertices=vertices.astype(np.float32),
        faces=faces.astype(np.int32),
        uv=uv[faces].astype(np.float32),
        texture=Image(pixels=image),
    )


def snap(mesh: Mesh, height: float) -> Mesh:
    """Move every vertex within `height` [m] of the support to z = 0."""
    vertices = mesh.vertices.copy()
    vertices[np.abs(vertices[:, 2]) <= height, 2] = 0.0
    return mesh.model_copy(update={"vertices": vertices})


def _marks(size: int, stride: int) -> np.ndarray:
    marks = np.arange(0, size, stride)
    return marks if marks[-1] == size - 1 else np.append(marks, size - 1)


def _world(pixels: np.ndarray, depths: np.ndarray, camera: Camera, world_from_camera: np.ndarray) -> np.ndarray:
    centre, focal = np.array([camera.cx, camera.cy]), np.array([camera.fx, camera.fy])
    flat = (pixels - centre) / focal * depths[:, None]
    return transforms.apply(world_from_camera, np.concatenate([flat, depths[:, None]], axis=1))
