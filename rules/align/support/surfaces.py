"""Find flat surfaces in a depth image."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dextera_build.geometry import planes, regions

CELL_M = 0.02
SAMPLES = 8000
GATE = 3.0
LEVEL_M = 0.008
"""Maximum mean distance of a surface cell from the plane [m]."""
CUT = 0.5
"""A plane that cuts through a wall has at least this fraction of its pixels in a cell directly below them, too."""
EDGE_ON = np.sin(np.radians(2.0))
"""Sine of the angle to the lines of sight below which a plane is none that is seen: noise of the depth lies in it."""
AROUND = 5
"""Edge length of the neighbourhood in which most cells tell where a plane cuts through a wall."""


@dataclass(frozen=True)
class Surface:
    """A connected flat region of the depth image."""

    plane: planes.Plane
    """Normal towards the camera, in the camera frame [m]."""
    region: np.ndarray
    """(H, W) bool, pixels of the surface."""
    outline: np.ndarray
    """(P, 2) convex outline in the plane's own x, y axes (see `axes`), about the camera's foot point [m]."""
    below: float
    """Fraction of the lines of sight through the outline that end below the plane; 0 for a true support."""
    carried: float = 0.0
    """Pixels of what stands on it, relative to its own; see `loads.loaded`."""

    @property
    def axes(self) -> np.ndarray:
        """Rows x (camera's right), y (away from the camera), z (normal) in the camera frame, (3, 3)."""
        return plane_axes(self.plane)

    @property
    def area_m2(self) -> float:
        """Area of the outline [m^2]."""
        return regions.area(self.outline)

    @property
    def tilt_rad(self) -> float:
        """Angle between the normal and the half circle of support normals possible for an upright camera."""
        normal = self.plane[0]
        return float(np.arccos(np.clip(np.hypot(min(normal[1], 0.0), normal[2]), 0.0, 1.0)))

    def lift(self, xy: np.ndarray) -> np.ndarray:
        """Map a point from the plane's own axes to the camera frame, (3,)."""
        foot = -self.plane[0] * self.plane[1]
        return np.asarray(foot + self.axes[0] * xy[0] + self.axes[1] * xy[1])


def plane_axes(plane: planes.Plane) -> np.ndarray:
    """World axes as rows (3, 3) in the camera frame: x the camera's right in the plane, y = z cross x, z the normal."""
    z = plane[0]
    x = np.array([1.0, 0.0, 0.0]) - z[0] * z
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def find(points: np.ndarray, valid: np.ndarray, most: int, warp_m: float, rng: np.random.Generator) -> list[Surface]:
    """Find planes, in the order in which they explain the pixels.

    Args:
        points: (H, W, 3) camera frame [m].
        valid: (H, W) bool, pixels to use.
        most: Maximum number of planes.
        warp_m: Unevenness added to the depth noise [m].
        rng: Source of the samples.
    """
    sigma = np.hypot(planes.depth_sigma(points[..., 2]), warp_m)
    left = valid.copy()
    found = []
    for _ in range(most):
        if left.sum() < 0.01 * valid.sum() or left.sum() < 500:
            break
        largest = planes.largest(points[left], sigma[left], rng, gate=GATE, sampled=SAMPLES)
        if largest is None:
            break
        near = left.copy()
        near[left] = largest[1]
        plane = planes.facing(largest[0])
        surface = _connected(plane, points, near, _just_below(plane, points, sigma, valid))
        if surface is not None:
            refined = _refined(surface, points, sigma, valid)
            away = float(np.median(np.linalg.norm(points[refined.region], axis=1)))
            found += [refined] if refined.plane[1] > EDGE_ON * away else []
        left &= ~near
    return found


def _just_below(plane: planes.Plane, points: np.ndarray, sigma: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Pixels (H, W) of a layer below a plane's inliers that is as thick as theirs."""
    distance = planes.distance(plane, points)
    return np.asarray(valid & (distance < -GATE * sigma) & (distance > -3.0 * GATE * sigma))


def _connected(plane: planes.Plane, points: np.ndarray, near: np.ndarray, below: np.ndarray) -> Surface | None:
    """The largest connected region of a plane's inliers, bridging gaps of a few cells.

    The line in which the plane cuts through the walls of a room is no part of it: it would extend the outline of a
    table to the walls behind it.

    Args:
        plane: Normal towards the camera, in the camera frame [m].
        points: (H, W, 3) camera frame [m].
        near: (H, W) bool, inliers.
        below: (H, W) bool, see `_just_below`.
    """
    axes = plane_axes(plane)
    xy = points[near] @ axes[:2].T
    if len(xy) < 100:
        return None
    cells = np.floor(xy / CELL_M).astype(np.int64)
    origin = cells.min(axis=0)
    cells -= origin
    shape = np.minimum(cells.max(axis=0) + 1, 2000)
    cells = np.minimum(cells, shape - 1)
    counts = np.zeros(tuple(shape + 4), np.int64)
    np.add.at(counts, (cells[:, 0] + 2, cells[:, 1] + 2), 1)
    distance = planes.distance(plane, points[near])
    sums = np.zeros(counts.shape)
    np.add.at(sums, (cells[:, 0] + 2, cells[:, 1] + 2), distance)
    # Noise averages out within a cell; a neighbouring surface a little lower does not.
    level = (counts > 2) & (np.abs(sums) < LEVEL_M * np.maximum(counts, 1))
    covered = np.zeros(counts.shape, bool)
    covered[tuple((_cells_above(plane, points, axes, origin, counts.shape)).T)] = True
    deeper = np.zeros(counts.shape, np.int64)
    np.add.at(deeper, tuple(_cells(points[below] @ axes[:2].T, origin, counts.shape).T), 1)
    cut = level & _cutting(level, deeper > CUT * counts)
    # Walls are cut in a line. A plane with most of its cells in front of something is in the noise of that.
    own = level & ~cut if 2 * cut.sum() < level.sum() else level
    # The front face of a table is below the cells at its edge, which belong to it.
    region = _bridged(regions.largest(_bridged(own) | covered, counts * own) & own) & level
    inside = region[cells[:, 0] + 2, cells[:, 1] + 2]
    if inside.sum() < 100:
        return None
    pixels = near.copy()
    pixels[near] = inside
    border = pixels & ~_between(pixels)
    return Surface(plane, pixels, regions.convex_hull(points[border] @ axes[:2].T), below=0.0)


def _cells_above(
    plane: planes.Plane, points: np.ndarray, axes: np.ndarray, origin: np.ndarray, shape: tuple[int, ...]
) -> np.ndarray:
    """Cells (N, 2) of the plane hidden by nearer objects; the surface may continue there."""
    coarse = points[::2, ::2].reshape(-1, 3)
    coarse = coarse[(coarse[:, 2] > 0) & (planes.distance(plane, coarse) > 0.01)]
    along = coarse @ plane[0]
    coarse, along = coarse[along < 0], along[along < 0]
    meets = coarse * (-plane[1] / along)[:, None]
    return _cells(meets @ axes[:2].T, origin, shape)


def _cells(xy: np.ndarray, origin: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Cells (M, 2) of those points (N, 2) of a plane [m] that are on its grid."""
    cells = np.floor(xy / CELL_M).astype(np.int64) - origin + 2
    return np.asarray(cells[((cells >= 0) & (cells < np.array(shape))).all(axis=1)])


def _cutting(level: np.ndarray, deeper: np.ndarray) -> np.ndarray:
    """Cells (h, w) of a plane in which it cuts through something, which goes on below it.

    Args:
        level: (h, w) bool, cells of the plane.
        deeper: (h, w) bool, cells with pixels below it; the noise leaves out some.
    """
    from scipy import ndimage

    cut, window = level & deeper, np.ones((AROUND, AROUND), np.int64)
    some, every = (ndimage.convolve(cells.astype(np.int64), window, mode="constant") for cells in (cut, level))
    return np.asarray(cut | (2 * some > every))


def _between(pixels: np.ndarray) -> np.ndarray:
    """Pixels of a mask between two others in their row, which cannot be corners of a plane's outline."""
    before = np.logical_or.accumulate(pixels, axis=1)
    after = np.logical_or.accumulate(pixels[:, ::-1], axis=1)[:, ::-1]
    between = np.zeros_like(pixels)
    between[:, 1:-1] = before[:, :-2] & after[:, 2:]
    return between


def _bridged(filled: np.ndarray) -> np.ndarray:
    """Dilate by one cell; two cells away is another surface."""
    grown = filled.copy()
    grown[1:] |= filled[:-1]
    grown[:-1] |= filled[1:]
    grown[:, 1:] |= grown[:, :-1].copy()
    grown[:, :-1] |= grown[:, 1:].copy()
    return grown


def _refined(surface: Surface, points: np.ndarray, sigma: np.ndarray, valid: np.ndarray) -> Surface:
    """Refit the surface to its own region only, without inliers beyond it."""
    plane = planes.facing(planes.refine(surface.plane, points[surface.region], sigma[surface.region], gate=GATE))
    near = valid & (np.abs(planes.distance(plane, points)) < GATE * sigma)
    surface = _connected(plane, points, near, _just_below(plane, points, sigma, valid)) or surface
    coarse, seen = points[::2, ::2], valid[::2, ::2]
    along = coarse @ surface.plane[0]
    # Intersections of the lines of sight with the plane; a true support ends them there or before.
    ahead = seen & (along < 0)
    meets = coarse * np.where(ahead, -surface.plane[1] / np.where(ahead, along, -1.0), 0.0)[..., None]
    within = ahead & regions.inside_convex(meets @ surface.axes[:2].T, surface.outline)
    low = within & (planes.distance(surface.plane, coarse) < -2.0 * GATE * sigma[::2, ::2])
    return replace(surface, below=float(low.sum() / max(1, within.sum())))
