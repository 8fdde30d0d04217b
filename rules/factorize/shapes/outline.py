"""Agreement between a mesh of unknown pose and the outline of an object in a photograph."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import raycast
from dextera_build.geometry.raycast import RayScene, Surface

_SIDE = 64
"""Number of cells per side of the grid on which outlines are compared."""
_TURNS = 36
_ELEVATIONS = np.radians([0.0, 15.0, 30.0, 45.0, 60.0, 75.0])
_FAR = 4.0
"""Distance of the camera in radii of the mesh: perspective typical for an object on a table."""
_SAMPLES = 4000


@dataclass(frozen=True)
class Explained:
    """The view of a mesh whose outline is most similar to the seen one."""

    iou: float
    """Intersection over union of the two outlines, each scaled to its own extent; occluded cells are left out."""
    unseen_fraction: float
    """Fraction of the surface area that this view does not see."""
    eye: np.ndarray
    """(3,) position of the camera, in the frame and unit of the mesh."""


def explain(vertices: np.ndarray, faces: np.ndarray, mask: np.ndarray, occluder: np.ndarray) -> Explained:
    """Compare the mesh with the mask, upright and turned in 36 steps, from six elevations.

    Args:
        vertices: (V, 3), z up.
        faces: (F, 3) int.
        mask: (H, W) bool, the object's visible pixels; not empty.
        occluder: (H, W) bool, pixels that may belong to the object.
    """
    centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2.0
    radius = float(np.linalg.norm(vertices - centre, axis=1).max())
    surface = Surface((vertices - centre) / radius, faces)
    scene, eyes = raycast.ray_scene([surface]), _eyes()
    hits = [scene.occluded(_rays(eye), np.inf) for eye in eyes]
    seen, hidden = _fitted(mask, mask), _fitted(occluder & ~mask, mask)
    ious = [_iou(_fitted(hit, hit), seen, hidden) if hit.any() else 0.0 for hit in hits]
    best = int(np.argmax(ious))
    return Explained(ious[best], _unseen(surface, scene, eyes[best]), centre + radius * eyes[best])


def _eyes() -> np.ndarray:
    """(N, 3) positions around the unit sphere."""
    turn, rise = np.meshgrid(np.arange(_TURNS) * 2.0 * np.pi / _TURNS, _ELEVATIONS)
    flat = np.stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)], axis=-1)
    return _FAR * flat.reshape(-1, 3)


def _rays(eye: np.ndarray) -> np.ndarray:
    """(side, side, 6) rays from `eye` over the unit sphere, rows from the top."""
    forward = -eye / np.linalg.norm(eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    half = 1.0 / np.sqrt(_FAR**2 - 1.0)  # tangent of the angular radius of the unit sphere
    steps = half * (2.0 * (np.arange(2 * _SIDE) + 0.5) / (2 * _SIDE) - 1.0)
    directions = forward + steps[None, :, None] * right + steps[:, None, None] * down
    return np.concatenate([np.broadcast_to(eye, directions.shape), directions], axis=-1)


def _fitted(picture: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The part of `picture` below the bounding box of `mask`, on the grid: larger side filled, smaller side centred."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    height, width = rows[-1] + 1 - rows[0], columns[-1] + 1 - columns[0]
    place = (np.arange(_SIDE) + 0.5) / _SIDE - 0.5
    longest = max(height, width)
    row = np.floor(rows[0] + height / 2.0 + place * longest).astype(int)
    column = np.floor(columns[0] + width / 2.0 + place * longest).astype(int)
    inside = ((row >= 0) & (row < picture.shape[0]))[:, None] & ((column >= 0) & (column < picture.shape[1]))[None, :]
    found = picture[np.clip(row, 0, picture.shape[0] - 1)][:, np.clip(column, 0, picture.shape[1] - 1)]
    return np.asarray(found & inside)


def _iou(made: np.ndarray, seen: np.ndarray, hidden: np.ndarray) -> float:
    both, either = made & seen & ~hidden, (made | seen) & ~hidden
    return float(both.sum() / max(int(either.sum()), 1))


def _unseen(surface: Surface, scene: RayScene, eye: np.ndarray) -> float:
    """Fraction of the area that is turned away from the camera or hidden by the mesh itself."""
    corners = surface.vertices[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    # Evenly spaced in area, so that the sample is deterministic.
    steps = (np.arange(_SAMPLES) + 0.5) / _SAMPLES * areas.sum()
    face = np.searchsorted(np.cumsum(areas), steps).clip(0, len(areas) - 1)
    points = corners[face].mean(axis=1)
    towards = eye - points
    faces_it = (normals[face] * towards).sum(axis=1) > 0
    rays = np.concatenate([points + 1e-3 * towards, towards], axis=1)
    return float(1.0 - (faces_it & ~scene.occluded(rays, np.inf)).mean())
