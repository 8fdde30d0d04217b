"""Locate a hinge: two slabs that meet at a crease, and the rotation of one onto the other."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import lie

from .. import manifolds

_CONE = np.cos(np.radians(15.0))
"""Cosine of the largest angle between a face's normal and its slab's."""

SLABS_SHARE = 0.75
"""Smallest fraction of a mesh's area along the normals of its two slabs; thicker or bent shapes have less."""
THICKEST = 0.4
"""Largest thickness of a slab, as a fraction of the side of a square of its area."""


@dataclass(frozen=True)
class Hinge:
    """A revolute joint between a lower and an upper slab; object frame.

    At angle 0 the upper slab rests on the lower one; positive angles open it.
    """

    origin: np.ndarray  # (3,) on the axis, at the centre of the upper slab [m]
    axis: np.ndarray  # (3,) unit, right-hand rule
    along: np.ndarray  # (3,) unit, in the lower slab's plane, from the hinge outward
    angle: float  # observed opening [rad]

    @property
    def up(self) -> np.ndarray:
        """Normal of the lower slab's inner side, (3,)."""
        return np.cross(self.axis, self.along)

    @property
    def bisector(self) -> np.ndarray:
        """Normal of the plane through the axis that separates the slabs, (3,); points to the upper one."""
        rotation = lie.turned(self.axis, np.zeros(3), (self.angle + np.pi) / 2.0)[:3, :3]
        return np.asarray(rotation @ self.along)

    def turn(self, angle: float) -> np.ndarray:
        """(4, 4) rotation about the hinge by `angle` [rad]."""
        return lie.turned(self.axis, self.origin, angle)

    def lifted(self, height: float) -> Hinge:
        """The hinge that raises the closed upper slab by `height` [m] and leaves the open one in place."""
        rotation = self.turn(-self.angle)[:3, :3]
        # Nothing moves along the axis; pinning that direction keeps the system regular.
        system = np.eye(3) - rotation + np.outer(self.axis, self.axis)
        return replace(self, origin=self.origin + np.linalg.solve(system, height * self.up))


def find(mesh: Mesh, least_angle: float = 0.15) -> Hinge | None:
    """Find the crease between the two largest slabs of a mesh, or None if the mesh has fewer.

    Two connected parts are the two slabs; a mesh in one part is grouped by face direction.

    Args:
        mesh: Closed, object frame, z up.
        least_angle: Slabs nearer to parallel than this [rad] have no locatable crease.
    """
    areas, normals = manifolds.areas_and_normals(mesh)
    parts = manifolds.components(mesh)
    if len(parts) >= 2 and areas[parts[1]].sum() > 0.1 * areas[parts[0]].sum():
        groups = parts[:2]
        slabs = [_dominant(normals[faces], areas[faces]) for faces in groups]
    else:
        slabs, groups = _by_direction(normals, areas)
    if len(groups) < 2 or abs(slabs[0] @ slabs[1]) > np.cos(least_angle):
        return None
    centroids = mesh.vertices[mesh.faces].mean(axis=1, dtype=np.float64)
    if not all(_thin(slab, centroids[faces], areas[faces]) for slab, faces in zip(slabs, groups, strict=True)):
        return None
    middles = [np.average(centroids[faces], axis=0, weights=areas[faces]) for faces in groups]
    low, high = (0, 1) if middles[0][2] <= middles[1][2] else (1, 0)
    planes = []
    for slab, mine, other in ((slabs[low], low, high), (slabs[high], high, low)):
        normal = slab if slab @ (middles[other] - middles[mine]) > 0.0 else -slab
        offset = _offset(normal, normals[groups[mine]], centroids[groups[mine]], areas[groups[mine]])
        if offset is None:
            return None
        planes.append((normal, offset))
    return _crease(planes, middles[low], middles[high])


def _by_direction(normals: np.ndarray, areas: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """The base's upright direction and the strongest other one, with the faces of each."""
    flat = np.abs(normals[:, 2]) > _CONE
    if not flat.any():
        return [], []
    base = _dominant(normals[flat], areas[flat])
    near = np.abs(normals @ base) > _CONE
    lid = _dominant(normals[~near], areas[~near]) if (~near).any() else base
    mine = (np.abs(normals @ lid) > _CONE) & ~near
    if areas[mine].sum() < 0.15 * areas[near].sum() or areas[near | mine].sum() < SLABS_SHARE * areas.sum():
        return [], []
    return [base, lid], [np.flatnonzero(near), np.flatnonzero(mine)]


def _thin(normal: np.ndarray, points: np.ndarray, areas: np.ndarray) -> bool:
    """Whether the faces along a normal are those of one thin slab."""
    along, size = points @ normal, float(np.sqrt(areas.sum() / 2.0))
    order = np.argsort(along, kind="stable")
    total = np.cumsum(areas[order])
    low, high = (along[order][np.searchsorted(total, share * total[-1])] for share in (0.1, 0.9))
    return bool(high - low < THICKEST * size)


def _dominant(normals: np.ndarray, areas: np.ndarray) -> np.ndarray:
    """Unit direction, up to sign, that most of the area faces; (3,)."""
    # Candidates are the normals of the largest faces: a slab has a few large faces, or many small parallel ones.
    order = np.argsort(-areas, kind="stable")
    candidates = normals[order[:: max(1, len(order) // 200)]]
    cosines = candidates @ normals.T
    best = int(np.argmax((np.abs(cosines) > _CONE) @ areas))
    mine = np.abs(cosines[best]) > _CONE
    signed = normals[mine] * np.sign(cosines[best, mine])[:, None] * areas[mine, None]
    total = signed.sum(axis=0)
    return np.asarray(total / np.linalg.norm(total))


def _offset(normal: np.ndarray, normals: np.ndarray, points: np.ndarray, areas: np.ndarray) -> float | None:
    """Distance of the plane with this normal from the origin: area-weighted median over its faces."""
    mine = normals @ normal > _CONE
    if not mine.any():
        return None
    along, weight = points[mine] @ normal, areas[mine]
    order = np.argsort(along, kind="stable")
    total = np.cumsum(weight[order])
    return float(along[order][np.searchsorted(total, total[-1] / 2.0)])


def _crease(planes: list[tuple[np.ndarray, float]], low: np.ndarray, high: np.ndarray) -> Hinge:
    (up, below), (front, behind) = planes
    line = np.cross(up, front)
    line /= np.linalg.norm(line)
    system = np.stack([up, front, line])
    origin = np.linalg.solve(system, np.array([below, behind, float(line @ high)]))
    along = np.cross(line, up)
    along *= np.sign(along @ (low - origin))
    inside = np.cross(line, front)
    inside *= np.sign(inside @ (high - origin))
    angle = float(np.arctan2(inside @ up, inside @ along)) % (2.0 * np.pi)
    return Hinge(origin, np.cross(along, up), along, angle)
