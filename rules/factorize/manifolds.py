"""Convert textured meshes to manifold3d solids and back."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import solids

if TYPE_CHECKING:
    from manifold3d import Manifold


def solid(mesh: Mesh) -> Manifold:
    """Convert a closed mesh to a manifold3d solid; texture coordinates become vertex properties.

    Raises:
        ValueError: The mesh is not a closed manifold.
    """
    import manifold3d

    if mesh.uv is None:
        made = solids.manifold(mesh.vertices, mesh.faces)
    else:
        # One vertex per face corner, because a seam vertex has two texture coordinates.
        corners = mesh.faces.reshape(-1)
        properties = np.concatenate([mesh.vertices[corners], mesh.uv.reshape(-1, 2)], axis=1)
        first = _first_with(corners)
        doubled = np.flatnonzero(first != np.arange(len(corners)))
        data = manifold3d.Mesh(
            _contiguous(properties, np.float32),
            np.arange(len(corners), dtype=np.uint32).reshape(-1, 3),
            merge_from_vert=doubled.astype(np.uint32),
            merge_to_vert=first[doubled].astype(np.uint32),
        )
        made = manifold3d.Manifold(data)
    if made.is_empty():
        raise ValueError(f"the mesh is not a closed manifold ({made.status().name})")
    return made


def mesh(made: Manifold, like: Mesh) -> Mesh:
    """Convert a solid to a mesh with the texture of `like`, from whose solid it was cut."""
    data = made.to_mesh()
    properties = np.asarray(data.vert_properties)
    triangles = np.asarray(data.tri_verts).astype(np.int64)
    welded = np.arange(len(properties))
    welded[np.asarray(data.merge_from_vert, np.int64)] = np.asarray(data.merge_to_vert, np.int64)
    used, faces = np.unique(welded[triangles], return_inverse=True)
    return Mesh(
        vertices=_contiguous(properties[used, :3], np.float32),
        faces=faces.reshape(-1, 3).astype(np.int32),
        uv=None if like.uv is None else _contiguous(properties[triangles, 3:5], np.float32),
        texture=like.texture,
        colour=like.colour,
    )


def components(mesh: Mesh) -> list[np.ndarray]:
    """Face indices of each connected part, largest area first."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    edges = np.concatenate([mesh.faces[:, :2], mesh.faces[:, 1:]])
    size = len(mesh.vertices)
    graph = coo_matrix((np.ones(len(edges), np.int8), (edges[:, 0], edges[:, 1])), shape=(size, size))
    _, labels = connected_components(graph, directed=False)
    owner = labels[mesh.faces[:, 0]]
    areas = areas_and_normals(mesh)[0]
    parts = [np.flatnonzero(owner == label) for label in np.unique(owner)]
    return sorted(parts, key=lambda faces: -float(areas[faces].sum()))


def subset(mesh: Mesh, faces: np.ndarray) -> Mesh:
    """The part of `mesh` with the given faces."""
    used, renumbered = np.unique(mesh.faces[faces], return_inverse=True)
    return mesh.model_copy(
        update={
            "vertices": _contiguous(mesh.vertices[used], np.float32),
            "faces": renumbered.reshape(-1, 3).astype(np.int32),
            "uv": None if mesh.uv is None else _contiguous(mesh.uv[faces], np.float32),
        }
    )


def areas_and_normals(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Area (F,) [m^2] and unit normal (F, 3) of every face; the normal of a degenerate face is 0."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    cross = np.cross(b - a, c - a)
    length = np.linalg.norm(cross, axis=1)
    return length / 2.0, cross / np.maximum(length, 1e-30)[:, None]


def _first_with(values: np.ndarray) -> np.ndarray:
    """For every position, the first position with the same value."""
    _, first, inverse = np.unique(values, return_index=True, return_inverse=True)
    return np.asarray(first[inverse])


def _contiguous(array: np.ndarray, kind: type) -> np.ndarray:
    # A copy, because manifold3d rejects read-only arrays, and artifacts' arrays are read-only.
    return np.array(array, dtype=kind, order="C")
