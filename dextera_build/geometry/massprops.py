"""Exact volume, centre of mass and inertia of closed triangle meshes, by the divergence theorem."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class MassProperties:
    """Integrals of a solid of density one, in the frame of its vertices."""

    volume: float  # [m^3]
    centre: np.ndarray  # (3,) float64, centre of mass [m]
    inertia: np.ndarray  # (3, 3) float64, about the centre, for density 1 kg/m^3 [kg m^2]

    def scaled(self, scale: float) -> MassProperties:
        """The solid scaled by `scale`: volume with the cube, inertia with the fifth power."""
        return MassProperties(self.volume * scale**3, self.centre * scale, self.inertia * scale**5)


def of_mesh(vertices: np.ndarray, faces: np.ndarray) -> MassProperties:
    """Integrate over the solid that a closed, outward oriented mesh bounds.

    The mesh is divided into tetrahedra about the mean of its vertices, which avoids cancellation far from the origin.
    Overlapping components count twice.

    Args:
        vertices: (V, 3) [m].
        faces: (F, 3) int, counter-clockwise from outside.

    Raises:
        ValueError: The volume is not positive: the mesh is open, flat or turned inside out.
    """
    middle = vertices.mean(axis=0, dtype=np.float64)
    corners = vertices.astype(np.float64)[faces] - middle
    total = corners.sum(axis=1)
    six_volumes = np.linalg.det(corners)
    volume = float(six_volumes.sum() / 6.0)
    if volume <= 0.0:
        raise ValueError(f"the volume is {volume:.3g} m3, a closed mesh with outward faces has a positive one")
    centre = six_volumes @ total / (24.0 * volume)
    # Second moments of a tetrahedron (0, a, b, c): det / 120 (aa' + bb' + cc' + ss'), s = a + b + c.
    vectors = np.concatenate([corners, total[:, None]], axis=1)
    second = np.einsum("f,fki,fkj->ij", six_volumes, vectors, vectors) / 120.0
    covariance = second - volume * np.outer(centre, centre)
    inertia = np.trace(covariance) * np.eye(3) - covariance
    return MassProperties(volume, centre + middle, inertia)


def principal(inertia: np.ndarray) -> np.ndarray:
    """Principal moments, (3,) ascending, of a symmetric (3, 3) inertia."""
    return np.linalg.eigvalsh(inertia)


def is_physical(inertia: np.ndarray, tolerance: float = 1e-9) -> bool:
    """Whether an inertia (3, 3) is physically possible: positive moments that satisfy the triangle inequality.

    Args:
        inertia: Symmetric, about the centre of mass [kg m^2].
        tolerance: Allowed relative excess of the largest moment.
    """
    small, middle, large = principal(inertia)
    return bool(small > 0.0 and large <= (small + middle) * (1.0 + tolerance))


def six(inertia: np.ndarray) -> tuple[float, float, float, float, float, float]:
    """ixx, iyy, izz, ixy, ixz, iyz of a symmetric (3, 3) inertia."""
    xx, yy, zz, xy, xz, yz = (float(inertia[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    return xx, yy, zz, xy, xz, yz


def matrix(values: tuple[float, ...]) -> np.ndarray:
    """The symmetric (3, 3) inertia of ixx, iyy, izz, ixy, ixz, iyz."""
    xx, yy, zz, xy, xz, yz = values
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
