"""Rectangular vessels with dividers: organisers, cutlery trays, tool boxes, trays for ice cubes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from dextera_build.geometry import solids, transforms
from dextera_build.geometry.raycast import RayScene
from dextera_build.geometry.solids import Solid

from ..evidence import Evidence
from ..refine import DEPTH_CAP, SOFT, Model
from . import open_box
from .box import upright
from .profile import THINNEST_M

MOST = 24
"""Maximum number of dividers."""
SPACING_M = 0.003
"""Spacing of the positions at which a divider is tried [m]."""
NARROWEST_M = 0.012
"""Minimum width of a compartment [m]."""
LEAST_GAIN = 0.03
"""Smallest decrease, by one divider, of the mean robust squared residual of the depth."""
LEAST_WRONG = 0.02
"""Smallest fraction of the rays that an empty vessel leaves unexplained: nearer than its inside shows."""
COST = 0.003
"""Complexity of one divider."""
ANY = 0.02
"""Complexity of having dividers at all: noise inside a mug must not become one."""
HEIGHTS = (1.0, 0.75)
"""Heights of the dividers that are tried, over that of the rim."""
OWN = 10
"""Number of parameters of the vessel; the thickness and height of all dividers and the position of each follow."""


@dataclass(frozen=True)
class Cell:
    """A compartment: what bounds it low and high along x and y, the number of a divider or -1 for a wall."""

    bounds: tuple[tuple[int, int], tuple[int, int]] = ((-1, -1), (-1, -1))


@dataclass(frozen=True)
class Divider:
    """A divider across `axis` that ends at the bounds of the compartment that it splits."""

    axis: int
    cell: Cell


@dataclass(frozen=True)
class Partition:
    """Dividers, each of which splits a compartment that the ones before it left."""

    dividers: tuple[Divider, ...] = ()
    cells: tuple[Cell, ...] = field(default=(Cell(),))

    def split(self, number: int, axis: int) -> Partition:
        """The partition with a divider across `axis` in compartment `number`."""
        cell, made = self.cells[number], len(self.dividers)
        halves = []
        for side in (1, 0):
            bounds = [list(pair) for pair in cell.bounds]
            bounds[axis][side] = made
            halves.append(Cell(((bounds[0][0], bounds[0][1]), (bounds[1][0], bounds[1][1]))))
        cells = (*self.cells[:number], *halves, *self.cells[number + 1 :])
        return Partition((*self.dividers, Divider(axis, cell)), cells)

    def slabs(self, p: np.ndarray) -> list[np.ndarray]:
        """Corners (8, 3) of every divider in the frame of the vessel, in the order of `solids.box`."""
        return [self.slab(p, divider, position) for divider, position in zip(self.dividers, p[OWN + 2 :], strict=True)]

    def slab(self, p: np.ndarray, divider: Divider, position: float) -> np.ndarray:
        """Corners (8, 3) of a divider at `position` along its axis; its ends follow the slope of the walls."""
        thick, height = p[OWN], min(p[OWN + 1], p[5])
        along = 1 - divider.axis
        corners = np.empty((8, 3))
        unit = solids.box((1.0, 1.0, 1.0)).vertices
        for corner, sign in zip(corners, np.sign(unit), strict=True):
            z = height if sign[2] > 0 else 0.0
            low, high = self._ends(p, divider.cell.bounds[along], along, z)
            corner[divider.axis] = position + sign[divider.axis] * thick / 2
            corner[along] = high if sign[along] > 0 else low
            corner[2] = z
        return corners

    def span(self, p: np.ndarray, cell: Cell, axis: int) -> tuple[float, float]:
        """Ends of a compartment along `axis` at the rim [m]."""
        return self._ends(p, cell.bounds[axis], axis, p[5])

    def _ends(self, p: np.ndarray, bounds: tuple[int, int], axis: int, z: float) -> tuple[float, float]:
        wall = p[3 + axis] / 2 - p[6] * (p[5] - z) - p[8] / 2
        low, high = (
            side * wall if number < 0 else float(p[OWN + 2 + number])
            for number, side in zip(bounds, (-1, 1), strict=True)
        )
        return low, high

    def body(self, p: np.ndarray) -> Solid:
        """The vessel and its dividers, unmerged, in the world."""
        parts = [open_box.open_box_body(p[:OWN]), *(Solid(slab, _FACES) for slab in self.slabs(p))]
        return solids.join(parts).moved(upright(p[0], p[1], p[2]))

    def pieces(self, p: np.ndarray) -> tuple[np.ndarray, ...]:
        """Corner points (V, 3) of exact convex pieces in the frame of the vessel."""
        return (*open_box.walls(p[:OWN]), *self.slabs(p))

    def solid(self, p: np.ndarray) -> Solid:
        """The vessel and its dividers as one surface, in its own frame."""
        return solids.union([open_box.open_box_body(p[:OWN]), *(Solid(slab, _FACES) for slab in self.slabs(p))])


_FACES = solids.box((1.0, 1.0, 1.0)).faces


def compartments(evidence: Evidence, vessel: Model, fitted: np.ndarray) -> tuple[Partition, Model] | None:
    """The dividers that the depth shows in a fitted vessel, and a model of both; None without any."""
    view = _View.of(evidence, fitted)
    if np.mean(view.seen < view.empty - DEPTH_CAP / 2 * evidence.ray_sigma) < LEAST_WRONG:
        return None
    tried = [
        _search(view, np.array([*fitted, max(fitted[8], THINNEST_M), part * fitted[5]]), axis)
        for part in HEIGHTS
        for axis in (0, 1)
    ]
    partition, start, _ = max(tried, key=lambda found: found[2])
    count = len(partition.dividers)
    if not count:
        return None
    assert vessel.expected is not None
    inf = np.inf
    more = [0.0] * count
    return partition, replace(
        vessel,
        name="compartments",
        build=partition.body,
        starts=[start],
        steps=np.array([*vessel.steps, 0.0015, 0.003, *[0.003] * count]),
        lower=np.array([*vessel.lower, THINNEST_M, 0.2 * fitted[5], *(start[OWN + 2 :] - NARROWEST_M)]),
        upper=np.array([*vessel.upper, 2 * NARROWEST_M, inf, *(start[OWN + 2 :] + NARROWEST_M)]),
        expected=np.array([*vessel.expected, fitted[8], start[OWN + 1], *more]),
        spread=np.array([*vessel.spread, 0.003, 0.05, *[inf] * count]),
        cost=vessel.cost + ANY + COST * count,
    )


@dataclass(frozen=True)
class _View:
    """The rays of a view in the frame of a vessel, with what they see and what an empty vessel would show [m]."""

    rays: np.ndarray  # (P, 6)
    seen: np.ndarray  # (P,)
    sigma: np.ndarray  # (P,)
    empty: np.ndarray  # (P,)

    @staticmethod
    def of(evidence: Evidence, p: np.ndarray) -> _View:
        vessel = transforms.invert(upright(p[0], p[1], p[2]))
        rays = np.concatenate(
            [transforms.apply(vessel, evidence.rays[:, :3]), evidence.rays[:, 3:] @ vessel[:3, :3].T], axis=1
        )
        body = open_box.open_box_body(p[:OWN])
        empty = RayScene((body.vertices, body.faces)).cast(rays).distance.astype(np.float64)
        return _View(rays, evidence.ray_depth, evidence.ray_sigma, empty)

    def loss(self, shown: np.ndarray) -> np.ndarray:
        """Robust squared residual (P,) of shown distances, as fits have it."""
        off = np.clip((shown - self.seen) / self.sigma, -DEPTH_CAP, DEPTH_CAP)
        return np.asarray(SOFT**2 * np.log1p(np.square(off) / SOFT**2))

    def met(self, slab: np.ndarray) -> np.ndarray:
        """Distance (P,) at which rays enter a slab, taken as the box around its corners (8, 3)."""
        start, ahead = self.rays[:, :3], self.rays[:, 3:]
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack([(bound - start) / ahead for bound in (slab.min(axis=0), slab.max(axis=0))])
        enter, leave = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
        return np.where((enter < leave) & (enter > 0), enter, np.inf)


def _search(view: _View, start: np.ndarray, first: int) -> tuple[Partition, np.ndarray, float]:
    """Add the divider that explains most of the depth until none explains enough: partition, parameters, gain.

    The first one is across axis `first`: where one compartment is divided again, the longest divider may not be first.
    """
    partition, p, shown, total = Partition(), start, view.empty, 0.0
    while len(partition.dividers) < MOST:
        before = view.loss(shown)
        best, gain = None, LEAST_GAIN
        for number, axis, position in _places(partition, p):
            if not partition.dividers and axis != first:
                continue
            slab = partition.slab(p, Divider(axis, partition.cells[number]), position)
            after = np.minimum(shown, view.met(slab))
            better = float((before - view.loss(after)).mean())
            if better > gain:
                best, gain = (number, axis, position, after), better
        if best is None:
            break
        number, axis, position, shown = best
        partition, p, total = partition.split(number, axis), np.append(p, position), total + gain
    return partition, p, total


def _places(partition: Partition, p: np.ndarray) -> Iterator[tuple[int, int, float]]:
    """Compartment, axis and position of every divider that leaves compartments wide enough."""
    for number, cell in enumerate(partition.cells):
        for axis in (0, 1):
            low, high = partition.span(p, cell, axis)
            for position in np.arange(low + NARROWEST_M, high - NARROWEST_M, SPACING_M):
                yield number, axis, float(position)
