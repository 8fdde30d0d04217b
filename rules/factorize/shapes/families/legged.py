"""Plates on legs or side panels, with free space below: stools, tables, tripods, racks, bridges."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import raycast, regions, solids
from dextera_build.geometry.solids import Solid

from ..evidence import Evidence, step
from ..refine import Model
from .box import LARGEST_M, SMALLEST_M, spans, upright

SIDES = 32
"""Facets of a round plate."""
TOP_M = 0.015
"""Points within this depth below the highest points may be on the plate [m]."""
LEAST_TOP = 0.2
"""Smallest fraction of the points on the plate."""
LEAST_HEIGHT_M = 0.03
"""Smallest height of a plate above the support [m]."""
BELOW = 0.75
"""Fraction of the height up to which the space below a plate is looked for."""
LEAST_FREE = 0.02
"""Smallest ratio of pixels seen through the space below the plate to pixels of the mask."""
ANGULAR, ROUND = 0.85, 0.97
"""Area of a plate over that of the smallest rectangle around most of it, above which it may be a rectangle, and below
which it may be round."""
PLATE_M, LEG_M = 0.012, 0.015
"""Expected thickness of a plate and of a leg [m]."""
THINNEST_M = 0.002
"""Minimum thickness of a plate or leg [m]."""


@dataclass(frozen=True)
class Layout:
    """Shape of the plate and number of legs. The parameters are x, y, yaw, height, plate, splay, and its own.

    The splay is the outward lean of a leg, horizontal over vertical. A rectangular plate has width, depth, thickness of
    a leg along both, and its inset from the edge; a round one has radius, thickness of a leg, and its inset.
    """

    legs: int
    round: bool

    def pieces(self, p: np.ndarray) -> list[Solid]:
        """The plate and the legs, convex, in the frame of the body; legs end inside the plate."""
        height, plate = p[3], min(p[4], 0.9 * p[3])
        return [self._plate(p, height - plate, height), *self._legs(p, height - plate / 2)]

    def body(self, p: np.ndarray) -> Solid:
        """All pieces, unmerged, in the world."""
        return solids.join(self.pieces(p)).moved(upright(p[0], p[1], p[2]))

    def _plate(self, p: np.ndarray, low: float, high: float) -> Solid:
        if self.round:
            return solids.loft(np.stack([solids.ring(p[6], p[6], 2.0, z, SIDES) for z in (low, high)]))
        return solids.box((p[6], p[7], high - low), (0.0, 0.0, (low + high) / 2))

    def _legs(self, p: np.ndarray, top: float) -> list[Solid]:
        lean = p[5] * p[3]
        if self.round:
            at = np.array([max(p[6] - p[8] - p[7] / 2, 0.0), 0.0])
            leg = _leg(np.array([p[7], p[7]]), at, at + np.array([lean, 0.0]), top)
            turns = 2 * np.pi * np.arange(self.legs) / self.legs
            return [leg.moved(upright(0.0, 0.0, turn)) for turn in turns]
        size = np.minimum(p[8:10], p[6:8] / 2)
        made = []
        for sign in ([-1, -1], [-1, 1], [1, -1], [1, 1]):
            at = np.array(sign) * np.maximum(p[6:8] / 2 - p[10] - size / 2, size / 2)
            made.append(_leg(size, at, at + np.array(sign) * lean, top))
        return made


def legged(evidence: Evidence) -> list[tuple[Layout, Model]]:
    """The kinds of plates on legs that are plausible; none unless the view shows free space below a plate."""
    top = _top(evidence)
    if top is None or free(evidence, top) < LEAST_FREE:
        return []
    starts = _rectangles(evidence, top)
    outline = regions.convex_hull(top)
    part = regions.area(outline) / float(starts[0][6] * starts[0][7])
    found = []
    if part > ANGULAR:
        layout = Layout(4, round=False)
        found.append((layout, _rectangular(layout, evidence, starts)))
    if part < ROUND:
        found += [
            (layout, _round(layout, evidence, outline)) for layout in (Layout(3, round=True), Layout(4, round=True))
        ]
    return found


def free(evidence: Evidence, top: np.ndarray) -> float:
    """Number of pixels, over that of the mask, that see past the body through the space below a plate (N, 2)."""
    under = solids.extrude(regions.convex_hull(top), 0.0, BELOW * evidence.height)
    height, width = evidence.mask.shape
    shown = raycast.render(
        [raycast.Surface(under.vertices, under.faces)], evidence.k, evidence.world_from_camera, height, width
    )
    beyond = (evidence.depth > shown.depth + step(evidence.sigma)) & (shown.index >= 0)
    through = np.count_nonzero(beyond & ~evidence.mask & evidence.known)
    return float(through) / max(float(np.count_nonzero(evidence.mask)), 1.0)


def _top(evidence: Evidence) -> np.ndarray | None:
    """Points (N, 2) of a level top, seen from above."""
    if evidence.height < LEAST_HEIGHT_M:
        return None
    level = (evidence.normals[:, 2] > 0.7) & (evidence.points[:, 2] > evidence.height - TOP_M)
    if level.mean() < LEAST_TOP:
        return None
    top = evidence.points[level, :2]
    return top if len(regions.convex_hull(top)) >= 3 else None


def _rectangles(evidence: Evidence, top: np.ndarray) -> list[np.ndarray]:
    """Rectangles around the plate, the smallest first, on legs, on panels across, and on panels along."""
    found = []
    for angle in np.deg2rad(np.arange(0.0, 90.0, 5.0)):
        low, high = spans(top, angle)
        size = np.maximum(high - low, 4 * SMALLEST_M)
        middle = upright(0.0, 0.0, angle)[:2, :2] @ ((low + high) / 2)
        found.append(np.array([*middle, angle, evidence.height, PLATE_M, 0.0, *size]))
    found.sort(key=lambda start: float(start[6] * start[7]))
    starts = []
    for start in found[:2]:
        x, y = start[6:8]
        starts += [np.array([*start, *leg, 0.004]) for leg in ((LEG_M, LEG_M), (LEG_M, y / 2), (x / 2, LEG_M))]
    return starts


def _rectangular(layout: Layout, evidence: Evidence, starts: list[np.ndarray]) -> Model:
    size = starts[0][6:8]
    inf = np.inf
    return _model(
        layout,
        evidence,
        starts,
        steps=[0.003, 0.003, 0.003, 0.003, 0.003],
        bounds=([4 * SMALLEST_M] * 2 + [THINNEST_M] * 2 + [0.0], [LARGEST_M] * 2 + [*(0.55 * size), 0.3 * size.min()]),
        expected=([*size, LEG_M, LEG_M, 0.004], [inf, inf, 0.1, 0.1, 0.02]),
    )


def _round(layout: Layout, evidence: Evidence, outline: np.ndarray) -> Model:
    middle = regions.centroid(outline)
    radius = float(np.sqrt(regions.area(outline) / np.pi))
    turns = 2 * np.pi / layout.legs * np.arange(8) / 8
    starts = [np.array([*middle, turn, evidence.height, PLATE_M, 0.0, radius, LEG_M, 0.004]) for turn in turns]
    return _model(
        layout,
        evidence,
        starts,
        steps=[0.003, 0.003, 0.003],
        bounds=([2 * SMALLEST_M, THINNEST_M, 0.0], [LARGEST_M / 2, 0.5 * radius, 0.6 * radius]),
        expected=([radius, LEG_M, 0.004], [np.inf, 0.02, 0.02]),
    )


def _model(
    layout: Layout,
    evidence: Evidence,
    starts: list[np.ndarray],
    steps: list[float],
    bounds: tuple[list[float], list[float]],
    expected: tuple[list[float], list[float]],
) -> Model:
    inf = np.inf
    build: Callable[[np.ndarray], Solid] = layout.body
    return Model(
        name="legged",
        build=build,
        starts=starts,
        steps=np.array([0.003, 0.003, 0.02, 0.003, 0.003, 0.02, *steps]),
        lower=np.array([-inf, -inf, -inf, LEAST_HEIGHT_M / 2, THINNEST_M, -0.1, *bounds[0]]),
        upper=np.array([inf, inf, inf, LARGEST_M, 0.5 * evidence.height, 0.5, *bounds[1]]),
        expected=np.array([0.0, 0.0, 0.0, evidence.height, PLATE_M, 0.0, *expected[0]]),
        spread=np.array([inf, inf, inf, 0.1, 0.02, 0.2, *expected[1]]),
        cost=0.01,
    )


def _leg(size: np.ndarray, top: np.ndarray, foot: np.ndarray, height: float) -> Solid:
    """A leg of cross-section (2,) from `foot` (2,) on z = 0 to `top` (2,) at a height [m]."""
    level = solids.box((size[0], size[1], height), (0.0, 0.0, height / 2))
    rise = level.vertices[:, 2:] / height
    return Solid(level.vertices + np.c_[rise * top + (1.0 - rise) * foot, np.zeros(len(rise))], level.faces)
