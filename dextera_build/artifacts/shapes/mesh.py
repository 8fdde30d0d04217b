"""Surfaces: textured triangle meshes and convex pieces."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from pydantic import model_validator

from dextera_build.artifacts.base import Array, Artifact
from dextera_build.artifacts.cameras.image import Image
from dextera_build.errors import ArtifactError


class Mesh(Artifact):
    """A triangle mesh with a texture."""

    vertices: Annotated[np.ndarray, Array("V 3", "float32", unit="m", frame="object")]
    """Corner positions (a background's are in the world frame)."""
    faces: Annotated[np.ndarray, Array("F 3", "int32")]
    """Vertex indices, counter-clockwise seen from outside."""
    uv: Annotated[np.ndarray, Array("F 3 2", "float32")] | None = None
    """Texture coordinates of each face's corners, origin at the lower left, v up; None without a texture."""
    texture: Image | None = None
    """Texture, or None for a plain colour."""
    colour: tuple[float, float, float] = (0.7, 0.7, 0.7)
    """sRGB 0..1 of a mesh without a texture."""

    @model_validator(mode="after")
    def _check_indices(self) -> Self:
        if len(self.faces) and (self.faces.min() < 0 or self.faces.max() >= len(self.vertices)):
            raise ArtifactError("Mesh.faces: an index is out of range of the vertices", code="DXB-A301")
        if (self.uv is None) != (self.texture is None):
            raise ArtifactError("Mesh: `uv` and `texture` go together", code="DXB-A302")
        return self

    @property
    def extent(self) -> np.ndarray:
        """Size of the axis-aligned bounding box, (3,) [m]."""
        return np.asarray(self.vertices.max(axis=0) - self.vertices.min(axis=0))

    @property
    def is_closed(self) -> bool:
        """Whether every edge is shared by exactly two faces in opposite directions (vertices merged by position)."""
        edges = np.concatenate([self.faces[:, [0, 1]], self.faces[:, [1, 2]], self.faces[:, [2, 0]]]).astype(np.int64)
        if not len(edges):
            return False
        count = np.int64(len(self.vertices))
        forward = np.sort(edges[:, 0] * count + edges[:, 1])
        backward = np.sort(edges[:, 1] * count + edges[:, 0])
        return bool((forward[1:] != forward[:-1]).all() and (forward == backward).all())

    def paint(self, face: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """SRGB (N, 3), 0..1, of points on faces (N,) at barycentric weights (N, 3)."""
        if self.uv is None or self.texture is None:
            return np.tile(np.array(self.colour), (len(face), 1))
        rows, columns = self.texture.pixels.shape[:2]
        u, v = (self.uv[face] * weight[..., None]).sum(axis=1).T
        row, column = ((1 - v) * rows).astype(int).clip(0, rows - 1), (u * columns).astype(int).clip(0, columns - 1)
        return np.asarray(self.texture.pixels[row, column] / 255.0)


class Hull(Artifact):
    """A convex piece, given by its corner points."""

    vertices: Annotated[np.ndarray, Array("V 3", "float32", unit="m", frame="object")]
    """Points whose convex hull is the piece; at least four, not in one plane."""
