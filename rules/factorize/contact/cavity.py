"""The cavity of a container, and the fraction of it that convex pieces wrongly fill."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.geometry.raycast import RayScene

_AROUND = 16
"""Number of horizontal rays cast from each point."""
_BLOCKED = 14
"""Number of rays that must hit a wall; the others allow for a spout or a notch in the rim."""


@dataclass(frozen=True)
class Cavity:
    """Regular grid points inside a cavity that is open at the top."""

    points: np.ndarray  # (N, 3) float64, object frame [m]
    volume: float  # [m^3]


def find(mesh: Mesh, cells: int = 40) -> Cavity:
    """Sample a container's cavity: free points with open sky above, a floor below and walls around.

    Args:
        mesh: Closed, object frame, z up.
        cells: Grid cells along the longest edge of the bounding box.
    """
    low, high = mesh.vertices.min(axis=0).astype(np.float64), mesh.vertices.max(axis=0).astype(np.float64)
    step = float((high - low).max()) / cells
    counts = np.maximum(np.ceil((high - low) / step).astype(int), 1)
    axes = [lo + (np.arange(n) + 0.5) * (hi - lo) / n for lo, hi, n in zip(low, high, counts, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    points = _sheltered(mesh, grid)
    return Cavity(points, float(np.prod((high - low) / counts)) * len(points))


def _sheltered(mesh: Mesh, points: np.ndarray) -> np.ndarray:
    scene = RayScene((mesh.vertices, mesh.faces))

    def free(at: np.ndarray, direction: np.ndarray) -> np.ndarray:
        rays = np.concatenate([at, np.broadcast_to(direction, at.shape)], axis=1)
        return np.asarray(np.isinf(scene.cast(rays).distance))

    # A point with open sky above is outside a closed mesh.
    points = points[free(points, np.array([0.0, 0.0, 1.0]))]
    points = points[~free(points, np.array([0.0, 0.0, -1.0]))]
    blocked = np.zeros(len(points), int)
    for turn in np.arange(_AROUND) * 2.0 * np.pi / _AROUND:
        blocked += ~free(points, np.array([np.cos(turn), np.sin(turn), 0.0]))
    return points[blocked >= _BLOCKED]


def fill(cavity: Cavity, hulls: Sequence[Hull]) -> float | None:
    """Fraction of the cavity filled by the pieces, 0..1; None without a cavity."""
    if not len(cavity.points):
        return None
    covered = np.zeros(len(cavity.points), bool)
    for hull in hulls:
        inside = np.ones(len(cavity.points), bool)
        for plane in half_spaces(hull):
            inside &= cavity.points @ plane[:3] + plane[3] <= 0.0
        covered |= inside
    return float(covered.mean())


def half_spaces(hull: Hull) -> np.ndarray:
    """Planes (P, 4) of a convex piece; x is inside where plane[:3] @ x + plane[3] <= 0 for all."""
    from scipy.spatial import ConvexHull

    return np.unique(np.round(ConvexHull(hull.vertices.astype(np.float64)).equations, 9), axis=0)
