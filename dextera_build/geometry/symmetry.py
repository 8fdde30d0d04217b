"""Rotational symmetry of a surface: axes through its centroid, their orders, and pose errors that respect them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from dextera_build.geometry import registration

ROUND = 0
"""Order of an axis about which every turn is a symmetry."""
ORDERS = (2, 3, 4, 5, 6, 8)
"""Finite orders that are looked for."""
ALIKE = 0.015
"""Distance between a turned surface and the surface, over its size, up to which they are the same."""
_ODD = (0.37, 0.9, 1.7)
"""Angles [rad] that are near no turn of a finite order; one for each of them would not do for order 17."""
_FEW = 40
"""Points that are turned first."""
_APART = np.radians(8.0)
"""Axes nearer to each other than this are one [rad]."""

Distances = Callable[[np.ndarray], np.ndarray]
"""Distance (N,) of model points (N, 3) to the surface, in model units."""


@dataclass(frozen=True)
class Axis:
    """One axis of symmetry."""

    direction: np.ndarray  # (3,) unit
    order: int  # turns by 2 pi / order are symmetries; `ROUND`: all are


@dataclass(frozen=True)
class Symmetry:
    """All axes that were found; none for a surface without rotational symmetry."""

    centre: np.ndarray  # (3,) point that all axes pass through, model units
    axes: tuple[Axis, ...]

    @property
    def round_axis(self) -> np.ndarray | None:
        """Direction (3,) of the axis of a surface of revolution; None for other surfaces. A ball has several."""
        found = [axis.direction for axis in self.axes if axis.order == ROUND]
        return found[0] if found else None

    @property
    def is_ball(self) -> bool:
        """Whether every rotation is a symmetry."""
        return sum(axis.order == ROUND for axis in self.axes) > 1

    def turns(self) -> np.ndarray:
        """The finite group (G, 3, 3) that the axes of finite order generate, identity first."""
        steps = [registration.rotation(axis.direction * (2.0 * np.pi / axis.order)) for axis in self.axes if axis.order]
        found = [np.eye(3)]
        for known in found:
            for step in steps:
                made = step @ known
                # Found axes are inexact: products nearer than 8 degrees are one element.
                if len(found) < 120 and all(np.trace(made.T @ other) < 1.0 + 2.0 * np.cos(_APART) for other in found):
                    found.append(made)
        return np.array(found)

    def angle(self, one: np.ndarray, other: np.ndarray) -> float:
        """Smallest angle [rad] between two (3, 3) rotations of the surface, over its symmetries."""
        if self.is_ball:
            return 0.0
        axis = self.round_axis
        if axis is not None:
            cosines = [float((one @ turn @ axis) @ (other @ axis)) for turn in self.turns()]
        else:
            cosines = [(float(np.trace((one @ turn).T @ other)) - 1.0) / 2.0 for turn in self.turns()]
        return float(np.arccos(np.clip(max(cosines), -1.0, 1.0)))

    def __str__(self) -> str:
        """`ball`, `round`, `order 2, 2, 4` or `none`."""
        if self.is_ball:
            return "ball"
        orders = sorted(axis.order for axis in self.axes)
        return ", ".join("round" if order == ROUND else f"order {order}" for order in orders) or "none"


def find(vertices: np.ndarray, faces: np.ndarray, distances: Distances, samples: int = 300) -> Symmetry:
    """Look for rotations that lay a surface onto itself.

    Every symmetry keeps the centroid and the second moments of the surface, so axes are principal axes, or, where
    moments are equal, follow from the largest faces: their normals, and the sums and products of two of them.

    Args:
        vertices: (V, 3), model units.
        faces: (F, 3) int.
        distances: To the surface.
        samples: Number of points that are turned.
    """
    corners = vertices[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(cross, axis=1)
    centre = np.average(corners.mean(axis=1), axis=0, weights=areas)
    points = _samples(corners, areas, samples)
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))

    def alike(direction: np.ndarray, angle: float) -> bool:
        turned = (points - centre) @ registration.rotation(direction * angle).T + centre
        # A few points refuse most of the axes.
        if (distances(turned[:_FEW]) > 2.0 * ALIKE * size).sum() > 0.1 * _FEW:
            return False
        return bool(np.quantile(distances(turned), 0.98) < ALIKE * size)

    found: list[Axis] = []
    for direction in _candidates(corners - centre, cross, areas):
        if any(abs(float(direction @ axis.direction)) > np.cos(_APART) for axis in found):
            continue
        if all(alike(direction, angle) for angle in _ODD):
            found.append(Axis(direction, ROUND))
        elif order := _order(partial(alike, direction)):
            found.append(Axis(direction, order))
    return Symmetry(centre, tuple(found))


def _order(alike: Callable[[float], bool]) -> int:
    """The largest order of which all turns up to half a circle are symmetries; 0 for none."""
    for order in reversed(ORDERS):
        if all(alike(2.0 * np.pi * step / order) for step in range(1, order // 2 + 1)):
            return order
    return 0


def _samples(corners: np.ndarray, areas: np.ndarray, count: int) -> np.ndarray:
    """Points (count, 3) spread over triangles (F, 3, 3) by area; the same for the same triangles."""
    random = np.random.default_rng(0)
    picked = random.choice(len(areas), count, p=areas / areas.sum())
    one, two = np.sqrt(random.uniform(size=count)), random.uniform(size=count)
    weights = np.stack([1.0 - one, one * (1.0 - two), one * two], axis=1)
    return np.asarray((corners[picked] * weights[..., None]).sum(axis=1))


def _candidates(corners: np.ndarray, cross: np.ndarray, areas: np.ndarray) -> list[np.ndarray]:
    """Unit directions: principal axes, the file's own axes, then normals of the largest faces and pairs of them."""
    # Second moments of a triangle (a, b, c) with centroid m: area / 12 (aa' + bb' + cc' + 9 mm').
    each = np.concatenate([corners, 3.0 * corners.mean(axis=1, keepdims=True)], axis=1)
    axes = [*np.linalg.eigh(np.einsum("f,fki,fkj->ij", areas, each, each))[1].T, *np.eye(3)]
    normals = cross / np.maximum(areas, 1e-30)[:, None]
    flats: list[np.ndarray] = []
    left = areas.copy()
    for _ in range(4):
        top = normals[int(np.argmax(left))]
        near = np.abs(normals @ top) > np.cos(np.radians(5.0))
        if left[near].sum() < 0.05 * areas.sum():
            break
        flats.append(top)
        left[near] = 0.0
    pairs = [(one, other) for k, one in enumerate(flats) for other in flats[:k]]
    made = [vector for one, other in pairs for vector in (one + other, one - other, np.cross(one, other))]
    unit = [vector / np.linalg.norm(vector) for vector in made if np.linalg.norm(vector) > 0.3]
    return [np.asarray(axis) for axis in (*axes, *flats, *unit)]
