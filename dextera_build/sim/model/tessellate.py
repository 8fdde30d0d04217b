"""Tessellate the geoms of a compiled MuJoCo model in the world frame."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from dextera_build.geometry.raycast import Surface

RINGS = 12
"""Rows from pole to equator, and facets per quarter circle."""


def surfaces(model: Any, data: Any) -> list[Surface]:
    """One surface per geom, in geom order, after `mj_forward`; planes and height fields give empty surfaces."""
    made = []
    for geom in range(model.ngeom):
        vertices, faces = surface(model, geom)
        rotation = data.geom_xmat[geom].reshape(3, 3)
        made.append(Surface(vertices @ rotation.T + data.geom_xpos[geom], faces))
    return made


def surface(model: Any, geom: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and triangles (F, 3) of one geom in its own frame [m]; of planes and height fields none."""
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        face, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
        return model.mesh_vert[first : first + count].astype(np.float64), model.mesh_face[face : face + faces]
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return turned(_arc(size[0], 0.0))
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return turned(_arc(size[0], size[1]))
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return turned(np.array([[0, -size[1]], [size[0], -size[1]], [size[0], size[1]], [0, size[1]]]))
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        vertices, faces = turned(_arc(1.0, 0.0))
        return vertices * size, faces
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        vertices, faces = turned(np.array([[0, -1], [np.sqrt(2), -1], [np.sqrt(2), 1], [0, 1]]), 4)
        c = np.sqrt(0.5)
        return vertices @ np.array([[c, c, 0], [-c, c, 0], [0, 0, 1]]) * size, faces
    return np.zeros((0, 3)), np.zeros((0, 3), np.int32)


def turned(profile: np.ndarray, segments: int = 4 * RINGS) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a profile (P, 2) of radius and z, revolved about z; its ends are on the axis."""
    angle = 2 * np.pi * np.arange(segments) / segments
    rows = len(profile)
    vertices = np.stack(
        [
            profile[:, :1] * np.cos(angle),
            profile[:, :1] * np.sin(angle),
            np.broadcast_to(profile[:, 1:], (rows, segments)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    row, column = np.meshgrid(np.arange(rows - 1), np.arange(segments), indexing="ij")
    a, b = row * segments + column, row * segments + (column + 1) % segments
    c, d = a + segments, b + segments
    faces = np.concatenate([np.stack([a, b, d], -1).reshape(-1, 3), np.stack([a, d, c], -1).reshape(-1, 3)])
    return vertices, faces.astype(np.int32)


def _arc(radius: float, half: float) -> np.ndarray:
    """Profile of a sphere of `radius` with its halves moved apart by `half` each."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 2 * RINGS)
    shift = np.where(np.arange(2 * RINGS) < RINGS, -half, half)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle) + shift], axis=1)
