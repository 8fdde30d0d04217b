"""Normals for shading a mesh."""

from __future__ import annotations

import numpy as np

CREASE = np.cos(np.radians(35.0))
"""Faces that meet at a sharper angle keep their edge when shaded."""


def corner_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit shading normals (3 F, 3) float64, one per face corner: smooth over gentle bends, sharp at creases."""
    places = vertices.astype(np.float64)[faces]
    area = np.cross(places[:, 1] - places[:, 0], places[:, 2] - places[:, 0])
    unit = area / np.maximum(np.linalg.norm(area, axis=1, keepdims=True), 1e-18)
    order = np.argsort(faces, axis=None, kind="stable")
    owner = order // 3
    starts = np.searchsorted(faces.flatten()[order], np.arange(len(vertices) + 1))
    normals = np.zeros((3 * len(faces), 3))
    for vertex in range(len(vertices)):
        around = slice(starts[vertex], starts[vertex + 1])
        met = owner[around]
        near = unit[met] @ unit[met].T > CREASE
        total = near.astype(np.float64) @ area[met]
        normals[order[around]] = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-18)
    return normals
