"""Closed triangle meshes of simple bodies, and boolean operations on them.

All bodies are wound counter-clockwise seen from outside, every edge is shared by two faces, lengths are in metres.
manifold3d does the booleans; it is imported at first use.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.geometry import transforms

if TYPE_CHECKING:
    from manifold3d import Manifold


@dataclass(frozen=True)
class Solid:
    """A closed surface."""

    vertices: np.ndarray  # (V, 3) float64 [m]
    faces: np.ndarray  # (F, 3) int64

    def moved(self, matrix: np.ndarray) -> Solid:
        """The solid under a (4, 4) rigid motion."""
        return Solid(transforms.apply(matrix, self.vertices), self.faces)

    @property
    def volume(self) -> float:
        """See `volume`."""
        return volume(self.vertices, self.faces)


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Enclosed volume [m^3], by the divergence theorem; negative if the surface is inside out."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return float((a * np.cross(b, c)).sum() / 6.0)


def box(size: Sequence[float] | np.ndarray, centre: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0)) -> Solid:
    """An axis-aligned box with edge lengths `size` (3,) about `centre` (3,)."""
    corners = np.array([[x, y, z] for z in (-0.5, 0.5) for y in (-0.5, 0.5) for x in (-0.5, 0.5)])
    faces = [
        [0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4],
        [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5],
    ]  # fmt: skip
    return Solid(corners * np.asarray(size) + np.asarray(centre), np.array(faces))


def loft(rings: np.ndarray) -> Solid:
    """A skin over closed rings (K, M, 3), with a flat fan as first and as last cap.

    Each ring is counter-clockwise seen from above. Rings up the outside, over a rim and down the inside form a vessel,
    whose last cap is the floor of the cavity.
    """
    vertices = np.concatenate([rings.reshape(-1, 3), [rings[0].mean(axis=0), rings[-1].mean(axis=0)]])
    return Solid(vertices, _skin(*rings.shape[:2]))


@lru_cache(maxsize=64)
def _skin(count: int, size: int) -> np.ndarray:
    """Faces of a loft over `count` rings of `size` corners; cached, because fits build the same loft repeatedly."""
    own = np.arange(count * size).reshape(count, size)
    following = np.roll(own, -1, axis=1)
    lower, lower_next, upper, upper_next = own[:-1], following[:-1], own[1:], following[1:]
    sides = np.concatenate(
        [np.stack([lower, lower_next, upper_next], -1), np.stack([lower, upper_next, upper], -1)], axis=0
    )
    bottom, top = count * size, count * size + 1
    first = np.stack([np.full(size, bottom), following[0], own[0]], -1)
    last = np.stack([np.full(size, top), own[-1], following[-1]], -1)
    faces = np.concatenate([sides.reshape(-1, 3), first, last])
    faces.flags.writeable = False
    return faces


def ring(a: float, b: float, exponent: float, z: float, count: int) -> np.ndarray:
    """(count, 3) points of the superellipse |x/a|^n + |y/b|^n = 1 at height `z`, counter-clockwise from +x."""
    corners = np.empty((count, 3))
    outline = _superellipse(float(exponent), count)
    corners[:, 0], corners[:, 1], corners[:, 2] = a * outline[0] * outline[2], b * outline[1] * outline[2], z
    return corners


@lru_cache(maxsize=64)
def _superellipse(exponent: float, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cosine and sine (count,) of the directions of a ring's corners, and the radius there if a = b = 1."""
    turn = np.arange(count) * (2.0 * np.pi / count)
    along, across = np.cos(turn), np.sin(turn)
    return along, across, (np.abs(along) ** exponent + np.abs(across) ** exponent) ** (-1.0 / exponent)


def join(parts: Sequence[Solid]) -> Solid:
    """Several closed surfaces as one mesh without merging: each remains a separate connected component."""
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    faces = [part.faces + start for part, start in zip(parts, starts, strict=True)]
    return Solid(np.concatenate([part.vertices for part in parts]), np.concatenate(faces))


def extrude(outline: np.ndarray, low: float, high: float) -> Solid:
    """A prism over a simple polygon (P, 2), from z = `low` to z = `high`."""
    return extrude_rings([outline], low, high)


def extrude_rings(outlines: Sequence[np.ndarray], low: float, high: float) -> Solid:
    """A prism over the region that polygons (P, 2) enclose an odd number of times, so that inner rings are holes."""
    import manifold3d as m3

    section = m3.CrossSection([np.asarray(outline, np.float64) for outline in outlines], m3.FillRule.EvenOdd)
    return from_manifold(m3.Manifold.extrude(section, high - low).translate((0.0, 0.0, low)))


def union(parts: Sequence[Solid]) -> Solid:
    """The union of all parts."""
    import manifold3d as m3

    return from_manifold(m3.Manifold.batch_boolean([_to_manifold(part) for part in parts], m3.OpType.Add))


def difference(body: Solid, taken: Solid) -> Solid:
    """`body` without `taken`."""
    return from_manifold(_to_manifold(body) - _to_manifold(taken))


def intersection(one: Solid, other: Solid) -> Solid:
    """The part of `one` inside `other`; empty if one of them is open."""
    return from_manifold(_to_manifold(one) ^ _to_manifold(other))


def largest(body: Solid) -> Solid:
    """The connected component with the largest volume."""
    parts = [from_manifold(part) for part in _to_manifold(body).decompose()]
    return max(parts, key=lambda part: part.volume)


def manifold(vertices: np.ndarray, faces: np.ndarray) -> Manifold:
    """A closed surface as a solid of manifold3d; an empty one if it is not closed.

    Args:
        vertices: (V, 3) [m]; in single precision, manifold3d merges vertices within that precision.
        faces: (F, 3) int.
    """
    import manifold3d as m3

    # It rejects read-only arrays, and the arrays of artifacts are read-only.
    if vertices.dtype == np.float32:
        return m3.Manifold(m3.Mesh(np.array(vertices, order="C"), np.array(faces, np.uint32, order="C")))
    corners, triangles = np.array(vertices, np.float64, order="C"), np.array(faces, np.uint64, order="C")
    return m3.Manifold(m3.Mesh64(corners, triangles))


def _to_manifold(solid: Solid) -> Manifold:
    return manifold(np.asarray(solid.vertices, np.float64), solid.faces)


def from_manifold(made: Manifold) -> Solid:
    """The surface of a solid of manifold3d."""
    mesh = made.to_mesh64()
    return Solid(np.array(mesh.vert_properties[:, :3], np.float64), np.array(mesh.tri_verts, np.int64))
