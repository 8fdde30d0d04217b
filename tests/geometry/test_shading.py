"""Shading normals of meshes."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import shading
from dextera_build.sim.model import tessellate


def test_a_ball_is_smooth() -> None:
    angle = np.linspace(-np.pi / 2, np.pi / 2, 24)
    vertices, faces = tessellate.turned(np.stack([np.cos(angle), np.sin(angle)], axis=1))
    normals = shading.corner_normals(vertices.astype(np.float32), faces)
    corners = vertices[faces.ravel()]
    away = np.abs(corners[:, 2]) < 0.98  # the poles are rings of equal points here
    assert (normals[away] * corners[away]).sum(axis=1).min() > 0.99


def test_a_cube_keeps_its_edges() -> None:
    corners = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], np.float32)
    faces = np.array([[0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4]], np.int32)
    normals = shading.corner_normals(corners, faces)
    np.testing.assert_allclose(np.abs(normals).max(axis=1), 1.0)
    np.testing.assert_allclose(normals[:6], np.tile([0.0, 0, -1], (6, 1)), atol=1e-12)
