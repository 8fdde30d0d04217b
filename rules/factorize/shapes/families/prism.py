"""Prisms over the outline of the mask, with holes and wells: scissors, keys, forks, bricks, racks for tubes.

The outline is that of the largest upright prism whose silhouette is within the mask (visual hull, Laurentini 1994):
the footprints of the mask on level planes from the support to the top, intersected. It keeps its openings, unlike
`extruded`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.geometry import cameras, regions, solids, transforms
from dextera_build.geometry.solids import Solid

from ..convex_parts import convex_parts
from ..evidence import Evidence, step
from ..refine import Model
from .box import SMALLEST_M, upright
from .hidden import completed

if TYPE_CHECKING:
    from manifold3d import CrossSection

CELLS = 380
"""Cells along the longer side of the footprint, at most."""
FINEST_M = 0.0007
"""Minimum size of a cell [m]."""
SIDES = 40
"""Facets of a round outline."""
MARGIN_M, HIDDEN = 0.01, 0.5
"""Margin of the footprint around the seen points [m], and over their extent if something hides a part of the body."""
LEVELS = 7
"""Level planes on which the mask is laid."""
LEVEL = 0.7
"""Minimum upward component of the normal on the top."""
RIM_M = 0.012
"""Points within this depth below the highest points are on the top [m]."""
LEAST_TOP = 0.15
"""Smallest fraction of the points on the top."""
NEAR_M = 0.001
"""Depth beyond the top, in addition to one standard deviation, at which the wall of an opening may begin [m]."""
LEAST_OPENING_M2 = 4e-5
"""Smallest area of a hole or well [m^2]."""
THIN_M, THIN = 0.02, 0.2
"""Largest height of a thin body, and the largest ratio of it to the longer side: without openings, only these."""
BEYOND = 0.05
"""Fraction of an opening's pixels outside the mask above which it goes through."""
MOST_HIDDEN = 0.5
"""Hidden fraction of a gap in the section above which it is no opening: a thing that stands there hides the top."""
SHALLOW = 0.12
"""Height of a well's floor over that of the body below which it is taken for a hole."""
SLACK_M = 0.0004
"""Tolerance of the outline's simplification, and of convex pieces [m]."""
SMOOTH_PX = 0.6
"""Standard deviation of the filter that smooths outlines [px]."""
REGULAR_PX = 0.6
"""Mean distance of an outline from a circle or rectangle below which it is taken for one [px]."""
PIECES = 96
"""Maximum number of convex pieces."""


@dataclass(frozen=True)
class Stencil:
    """A prism of unit height over a section, with the floors of its wells. The parameters are x, y, growth, height."""

    rings: tuple[np.ndarray, ...]  # (P, 2) outline and openings about the centre [m]
    wells: tuple[tuple[np.ndarray, float], ...]  # outline (P, 2) [m] and height of the floor, 0..1
    unit: Solid

    def body(self, p: np.ndarray) -> Solid:
        """The prism in its own frame, base on z = 0."""
        return Solid(self.unit.vertices * p[2:5], self.unit.faces)

    def placed(self, p: np.ndarray) -> Solid:
        """The prism in the world."""
        return self.body(p).moved(upright(p[0], p[1], 0.0))

    def pieces(self, p: np.ndarray) -> tuple[np.ndarray, ...]:
        """Corner points (V, 3) of convex pieces in the prism's own frame, which keep the openings free."""
        made = []
        for rings, high in ((self.rings, 1.0), *(((ring,), floor) for ring, floor in self.wells)):
            for part in convex_parts(rings, SLACK_M, PIECES):
                made.append(np.concatenate([np.c_[part, np.full(len(part), z)] for z in (0.0, high)]) * p[2:5])
        return tuple(made)


def prism(evidence: Evidence) -> tuple[Stencil, Model] | None:
    """The section and a model: x, y, growth in x and y, height; None without openings unless the body is thin."""
    grid = _Grid.of(evidence)
    if grid is None:
        return None
    full, openings = grid.section()
    if not full.any():
        return None
    extent = grid.cell * float(np.ptp(np.argwhere(full), axis=0).max())
    if not openings and grid.top > min(THIN_M, THIN * extent):
        return None
    stencil, middle = _stencil(grid, full, openings)
    size = max(extent, 0.01)
    model = Model(
        name="prism",
        build=stencil.placed,
        starts=[np.array([*middle, 1.0, 1.0, grid.top])],
        steps=np.array([0.001, 0.001, 0.001 / size, 0.001 / size, 0.002]),
        lower=np.array([-np.inf, -np.inf, 0.85, 0.85, SMALLEST_M / 2]),
        upper=np.array([np.inf, np.inf, 1.15, 1.15, 1.5 * grid.top]),
        cost=0.05,
    )
    return stencil, model


@dataclass(frozen=True)
class _Grid:
    """Cells of the ground plane, and where the picture shows points above them."""

    evidence: Evidence
    low: np.ndarray  # (2,) corner of the first cell [m]
    cell: float  # [m]
    shape: tuple[int, int]  # cells along y and x
    top: float  # height of the top [m]
    known: np.ndarray  # pixels (h, w) that show the body or what is beside and beyond it

    @staticmethod
    def of(evidence: Evidence) -> _Grid | None:
        points = evidence.points
        level = (evidence.normals[:, 2] > LEVEL) & (points[:, 2] > evidence.height - RIM_M)
        if level.mean() < LEAST_TOP:
            return None
        top = float(np.median(points[level, 2]))
        if top < SMALLEST_M / 2:
            return None
        low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
        known = evidence.known & ~_standing(evidence, top)
        margin = MARGIN_M if known.all() else max(MARGIN_M, HIDDEN * float((high - low).max()))
        low, high = low - margin, high + margin
        cell = max(float((high - low).max()) / CELLS, FINEST_M)
        columns, rows = np.ceil((high - low) / cell).astype(int)
        return _Grid(evidence, low, cell, (int(rows), int(columns)), top, known)

    @property
    def pixel(self) -> float:
        """Size of a pixel on the body [m]."""
        return float(np.median(self.evidence.ray_depth)) / float(self.evidence.k[0, 0])

    def section(self) -> tuple[np.ndarray, list[tuple[np.ndarray, float]]]:
        """Cells (H, W) bool that are full up to the top, and every opening with the height of its floor [m]."""
        from scipy import ndimage

        evidence = self.evidence
        at, ahead = self._seen(self.top)
        behind = np.ones(self.shape, bool)
        for height in np.linspace(0.0, self.top, LEVELS)[:-1]:
            behind &= _share(evidence.mask | ~self.known, self._seen(float(height))[0]) > 0.5
        full = (_share(evidence.mask, at) > 0.5) & behind & ~self._deeper(at, ahead)
        full = ndimage.binary_opening(ndimage.binary_closing(full, iterations=1), iterations=1)
        hidden = _at(~self.known, at)
        full = completed(_large(full, LEAST_OPENING_M2 / self.cell**2), behind & hidden)
        closed = ndimage.binary_fill_holes(full)
        labels, count = ndimage.label(closed & ~full)
        openings = []
        for number in range(1, count + 1):
            opening = labels == number
            if np.count_nonzero(opening) * self.cell**2 < LEAST_OPENING_M2 or hidden[opening].mean() > MOST_HIDDEN:
                full |= opening
            else:
                openings.append((opening, self._floor(opening, at)))
        return full, openings

    def outline(self, cells: np.ndarray) -> list[np.ndarray]:
        """Outlines (P, 2) of cells, with those of their holes [m]."""
        import cv2
        from scipy import ndimage

        fine = cv2.resize(np.pad(cells, 2).astype(np.float32), None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)
        smooth = (ndimage.gaussian_filter(fine, 2.0 * SMOOTH_PX * self.pixel / self.cell) > 0.5).astype(np.uint8)
        contours, _ = cv2.findContours(smooth, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        slack = max(2.0 * SLACK_M / self.cell, 0.8)
        rings = [cv2.approxPolyDP(contour, slack, True)[:, 0].astype(np.float64) for contour in contours]
        made = [self.low + ((ring + 0.5) / 2.0 - 2.0) * self.cell for ring in rings if len(ring) >= 3]
        return [regular(ring, REGULAR_PX * self.pixel) for ring in made]

    def innermost(self, cells: np.ndarray) -> np.ndarray:
        """The point (2,) that is farthest from the border of a region of cells [m]."""
        from scipy import ndimage

        row, column = np.unravel_index(np.argmax(ndimage.distance_transform_edt(cells)), cells.shape)
        return np.asarray(self.low + (np.array([column, row]) + 0.5) * self.cell)

    def _seen(self, height: float) -> tuple[np.ndarray, np.ndarray]:
        """Pixel (H, W, 2) (column, row) and depth (H, W) [m] of the middle of every cell at a height."""
        rows, columns = np.indices(self.shape)
        flat = self.low + (np.stack([columns, rows], axis=-1) + 0.5) * self.cell
        points = np.concatenate([flat, np.full((*self.shape, 1), height)], axis=-1).reshape(-1, 3)
        local = transforms.apply(transforms.invert(self.evidence.world_from_camera), points)
        pixels = cameras.project(local, self.evidence.k)
        return pixels.reshape(*self.shape, 2), local[:, 2].reshape(self.shape)

    def _deeper(self, at: np.ndarray, ahead: np.ndarray) -> np.ndarray:
        """Whether the picture shows something beyond the top of each cell; lost depth is that of the next pixel.

        The far wall of an opening begins at the top, so what is a little deeper counts beside what is surely deeper.
        """
        from scipy import ndimage

        depth, mask = self.evidence.depth, self.evidence.mask
        lost = ~((depth > 0) & mask)
        nearest = ndimage.distance_transform_edt(lost, return_distances=False, return_indices=True)
        filled = ndimage.median_filter(depth[nearest[0], nearest[1]], 5)
        sigma = self.evidence.sigma[nearest[0], nearest[1]]
        beyond = _at(filled, at) - ahead
        surely, likely = beyond > _at(step(sigma), at), beyond > NEAR_M + _at(sigma, at)
        return np.asarray(ndimage.binary_propagation(surely, mask=likely))

    def _floor(self, opening: np.ndarray, at: np.ndarray) -> float:
        """Height of the floor of an opening [m]; 0 if the support is seen through it."""
        evidence = self.evidence
        pixels = np.round(at[opening]).astype(int)
        rows = np.clip(pixels[:, 1], 0, len(evidence.mask) - 1)
        columns = np.clip(pixels[:, 0], 0, evidence.mask.shape[1] - 1)
        open_to_view = self.known[rows, columns]
        if not open_to_view.any():
            return 0.0 if self.top < THIN_M else 0.5 * self.top
        if (~evidence.mask[rows, columns])[open_to_view].mean() > BEYOND:
            return 0.0
        within = np.zeros_like(evidence.mask)
        within[rows, columns] = True
        inside = within[evidence.core]
        own = evidence.points[: len(inside)]
        if np.count_nonzero(inside) < 8:
            return 0.5 * self.top
        floor = float(np.quantile(own[inside, 2], 0.15))
        return 0.0 if floor < SHALLOW * self.top else min(floor, 0.9 * self.top)


def _stencil(grid: _Grid, full: np.ndarray, openings: list[tuple[np.ndarray, float]]) -> tuple[Stencil, np.ndarray]:
    """The prism about its centre, and the centre (2,) [m]."""
    rings = grid.outline(full)
    every = np.concatenate(rings)
    middle = (every.min(axis=0) + every.max(axis=0)) / 2
    centred = tuple(ring - middle for ring in rings)
    wells = []
    for cells, floor in openings:
        around = _around(rings, grid.innermost(cells))
        if floor > 0 and around is not None:
            wells.append((centred[around], floor / grid.top))
    parts = [solids.extrude_rings(centred, 0.0, 1.0)]
    parts += [solids.extrude_rings([ring], 0.0, floor) for ring, floor in wells]
    return Stencil(centred, tuple(wells), solids.union(parts)), middle


def regular(ring: np.ndarray, slack_m: float) -> np.ndarray:
    """The circle or the rectangle of an outline (P, 2) if it is within `slack_m` of one on average; else the outline.

    Both have the area of the outline.
    """
    import cv2

    given, size = _section(ring), abs(regions.area(ring))
    turns = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)
    circle = regions.centroid(ring) + np.sqrt(size / np.pi) * np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    box = cv2.boxPoints(cv2.minAreaRect(ring.astype(np.float32))).astype(np.float64)
    middle = box.mean(axis=0)
    box = middle + (box - middle) * np.sqrt(size / max(abs(regions.area(box)), 1e-12))
    perimeter = float(np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1).sum())
    off = {}
    for number, other in enumerate((circle, box)):
        section = _section(other)
        off[number] = float((given - section).area() + (section - given).area()) / perimeter
    best = min(off, key=lambda number: off[number])
    return (circle, box)[best] if off[best] < slack_m else ring


def _standing(evidence: Evidence, top: float) -> np.ndarray:
    """Pixels (h, w) of other things that reach higher than the top [m], such as one that stands on it."""
    points = cameras.backproject(evidence.depth, evidence.k)
    height = transforms.apply(evidence.world_from_camera, points.reshape(-1, 3))[:, 2].reshape(evidence.mask.shape)
    return np.asarray(~evidence.mask & (evidence.depth > 0) & (height > top + RIM_M))


def _section(ring: np.ndarray) -> CrossSection:
    import manifold3d as m3

    return m3.CrossSection([ring], m3.FillRule.EvenOdd)


def _around(rings: list[np.ndarray], point: np.ndarray) -> int | None:
    """The smallest ring around a point (2,)."""
    import cv2

    place = (float(point[0]), float(point[1]))
    within = [n for n, ring in enumerate(rings) if cv2.pointPolygonTest(ring.astype(np.float32), place, False) > 0]
    return min(within, key=lambda number: abs(regions.area(rings[number])), default=None)


def _at(values: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Values (H, W) at the pixels (..., 2) nearest to positions (column, row); 0 beyond the border."""
    nearest = np.round(pixels).astype(int)
    height, width = values.shape
    within = (nearest >= 0).all(axis=-1) & (nearest[..., 0] < width) & (nearest[..., 1] < height)
    clipped = np.clip(nearest, 0, [width - 1, height - 1])
    return np.where(within, values[clipped[..., 1], clipped[..., 0]], np.zeros((), values.dtype))


def _share(mask: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Share (H, W) of a mask at positions (..., 2) (column, row), between pixels; 0 beyond the border."""
    from scipy import ndimage

    places = np.moveaxis(pixels[..., ::-1], -1, 0)
    return np.asarray(ndimage.map_coordinates(mask.astype(np.float32), places, order=1, mode="constant"))


def _large(cells: np.ndarray, least: float) -> np.ndarray:
    """The connected regions with at least `least` cells."""
    from scipy import ndimage

    labels, _ = ndimage.label(cells)
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return np.asarray((sizes >= least)[labels])
