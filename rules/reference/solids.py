"""Parametric closed textured surfaces: boxes, slabs with round corners, bodies of revolution, bent tubes.

Every function returns a `Mesh` with shared vertices (closed by index) and texture coordinates, with its base on z = 0
and centred on x and y unless noted otherwise; lengths in metres.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import solids, transforms

if TYPE_CHECKING:
    from manifold3d import Manifold

CELLS = ("front", "right", "back", "left", "top", "bottom")
"""Faces of a box in the order of its atlas: three columns, two rows, row by row from the upper left."""


def box(size: tuple[float, float, float], picture: np.ndarray, *, atlas: bool = False) -> Mesh:
    """A box of `size` (x, y, z).

    Every face shows all of `picture`, or with `atlas` its cell in the order of `CELLS`, upright from outside.
    """
    x, y, z = size[0] / 2, size[1] / 2, size[2]
    corners = np.array([[i, j, k] for k in (0.0, z) for j in (-y, y) for i in (-x, x)], np.float32)
    # Lower left, lower right, upper right, upper left, seen from outside; `front` looks along -y.
    quads = [(0, 1, 5, 4), (1, 3, 7, 5), (3, 2, 6, 7), (2, 0, 4, 6), (4, 5, 7, 6), (2, 3, 1, 0)]
    faces, uv = [], []
    for cell, (a, b, c, d) in enumerate(quads):
        square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
        if atlas:
            square = square * [1 / 3, 1 / 2] + [(cell % 3) / 3, 1.0 - (cell // 3 + 1) / 2]
        faces += [(a, b, c), (a, c, d)]
        uv += [square[[0, 1, 2]], square[[0, 2, 3]]]
    return _mesh(corners, np.array(faces), np.array(uv), picture)


def slab(size: tuple[float, float, float], radius: float, bevel: float, picture: np.ndarray) -> Mesh:
    """A box of `size` with vertical edges of `radius` and bevelled rims.

    The upper half of `picture` is mapped to the top, the lower half to the bottom; sides use the lower half's border.
    """
    x, y, z = size
    levels = [(0.0, bevel), (bevel, 0.0), (z - bevel, 0.0), (z, bevel)]
    rings = [np.c_[_round_rectangle(x - 2 * i, y - 2 * i, radius - i), np.full(32, h)] for h, i in levels]
    vertices = np.concatenate([*rings, [[0, 0, 0], [0, 0, z]]])
    faces: list[tuple[int, int, int]] = []
    for level in range(3):
        for a in range(32):
            b = (a + 1) % 32
            low, high = level * 32, (level + 1) * 32
            faces += [(low + a, low + b, high + b), (low + a, high + b, high + a)]
    faces += [((a + 1) % 32, a, 128) for a in range(32)]
    faces += [(96 + a, 96 + (a + 1) % 32, 129) for a in range(32)]
    triangles = np.array(faces)
    flat = vertices[:, :2] / [x, y] + 0.5
    uv = flat[triangles] * [1.0, 0.5]
    uv[-32:, :, 1] += 0.5
    return _mesh(vertices, triangles, uv, picture)


def turned(profile: np.ndarray, picture: np.ndarray, segments: int = 96) -> Mesh:
    """A surface of revolution about z.

    Args:
        profile: (P, 2) radius and height, from the axis at the bottom along the outside back to the axis.
        picture: Texture; u runs around the axis, v along the profile's length.
        segments: Facets of the circle.
    """
    angle = 2 * np.pi * np.arange(segments) / segments
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    body = profile[1:-1]
    rings = np.concatenate([np.c_[circle * r, np.full(segments, z)] for r, z in body])
    vertices = np.concatenate([rings, [[0, 0, profile[0, 1]], [0, 0, profile[-1, 1]]]])
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1))])
    along = length / length[-1]
    faces: list[tuple[int, int, int]] = []
    uv: list[list[tuple[float, float]]] = []
    first, last, count = len(rings), len(rings) + 1, len(body)
    for a in range(segments):
        b, u, w = (a + 1) % segments, a / segments, (a + 1) / segments
        faces.append((b, a, first))
        uv.append([(w, along[1]), (u, along[1]), (u, 0.0)])
        for row in range(count - 1):
            low, high = row * segments, (row + 1) * segments
            faces += [(low + a, low + b, high + b), (low + a, high + b, high + a)]
            uv.append([(u, along[row + 1]), (w, along[row + 1]), (w, along[row + 2])])
            uv.append([(u, along[row + 1]), (w, along[row + 2]), (u, along[row + 2])])
        top = (count - 1) * segments
        faces.append((top + a, top + b, last))
        uv.append([(u, along[-2]), (w, along[-2]), (u, 1.0)])
    return _mesh(vertices, np.array(faces), np.array(uv), picture)


def tube(path: np.ndarray, half_width: float, half_thickness: float, picture: np.ndarray, segments: int = 20) -> Mesh:
    """A bar with elliptic section along a curve in the plane y = 0, closed at both ends.

    Args:
        path: (N, 3) points of the centre line [m], y = 0.
        half_width: Half axis along y [m].
        half_thickness: Half axis in the plane of the curve [m].
        picture: Texture; u runs around the section, v along the curve.
        segments: Facets of the section.
    """
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    across = np.cross(tangent, [0.0, 1.0, 0.0])
    angle = 2 * np.pi * np.arange(segments) / segments
    ring = half_thickness * np.cos(angle)[None, :, None] * across[:, None]
    ring = ring + half_width * np.sin(angle)[None, :, None] * np.array([0.0, 1.0, 0.0])
    vertices = np.concatenate([(path[:, None] + ring).reshape(-1, 3), path[[0, -1]]])
    faces: list[tuple[int, int, int]] = []
    for row in range(len(path) - 1):
        low, high = row * segments, (row + 1) * segments
        for a in range(segments):
            b = (a + 1) % segments
            faces += [(low + a, high + b, low + b), (low + a, high + a, high + b)]
    end = (len(path) - 1) * segments
    first = len(path) * segments
    faces += [(a, (a + 1) % segments, first) for a in range(segments)]
    faces += [(end + (a + 1) % segments, end + a, first + 1) for a in range(segments)]
    triangles = np.array(faces)
    v = np.append(np.repeat(np.linspace(0, 1, len(path)), segments), [0.0, 1.0])
    u = np.append(np.tile(np.arange(segments) / segments, len(path)), [0.5, 0.5])
    mesh = _mesh(vertices, triangles, np.stack([u, v], axis=1)[triangles], picture)
    return mesh if volume(mesh) > 0 else mesh.model_copy(update={"faces": mesh.faces[:, ::-1].copy()})


def volume(mesh: Mesh) -> float:
    """Signed volume of a closed mesh [m^3]; positive for outward faces."""
    return solids.volume(mesh.vertices.astype(np.float64), mesh.faces)


def union(meshes: list[Mesh]) -> Mesh:
    """The outer surface of overlapping closed meshes, without textures."""
    import manifold3d

    whole = manifold3d.Manifold()
    for mesh in meshes:
        whole += solid(mesh)
    joined = whole.to_mesh()
    return Mesh(vertices=joined.vert_properties[:, :3].astype(np.float32), faces=joined.tri_verts.astype(np.int32))


def gap(one: Mesh, other: Mesh, most: float = 0.05) -> float:
    """Distance between two closed surfaces in one frame [m], at most `most`; 0 if they overlap."""
    return float(solid(one).min_gap(solid(other), most))


def moved(mesh: Mesh, matrix: np.ndarray) -> Mesh:
    """Transform the mesh by a rigid (4, 4) motion."""
    vertices = transforms.apply(matrix, mesh.vertices.astype(np.float64))
    return mesh.model_copy(update={"vertices": vertices.astype(np.float32)})


def solid(mesh: Mesh) -> Manifold:
    """See `dextera_build.geometry.solids.manifold`."""
    return solids.manifold(mesh.vertices.astype(np.float64), mesh.faces)


def _round_rectangle(x: float, y: float, radius: float) -> np.ndarray:
    angle = np.concatenate([np.linspace(0, np.pi / 2, 8) + quarter * np.pi / 2 for quarter in range(4)])
    middle = np.repeat([[1, 1], [-1, 1], [-1, -1], [1, -1]], 8, axis=0) * [x / 2 - radius, y / 2 - radius]
    return np.asarray(middle + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))


def _mesh(vertices: np.ndarray, faces: np.ndarray, uv: np.ndarray, picture: np.ndarray) -> Mesh:
    return Mesh(
        vertices=vertices.astype(np.float32),
        faces=faces.astype(np.int32),
        uv=uv.astype(np.float32),
        texture=Image(pixels=np.ascontiguousarray(picture, np.uint8)),
    )
