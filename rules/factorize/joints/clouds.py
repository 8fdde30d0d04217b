"""Points with normals, and surface borders, of a depth image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.objects.view import Seen
from dextera_build.geometry import cameras, normals, planes, regions, transforms
from dextera_build.geometry.depth_view import DepthView

MOST = 5000
"""Maximum number of points of a cloud; more change no estimate, because errors of neighbours are correlated."""
WINDOW_PX = 3
"""Half width of the window in which a normal is fitted [px]."""
BAND_PX = 5
"""Width of the band along a border in which depth may be missing [px]."""
FACE = 40
"""Number of surface points next to a border from which the orientation of its face is estimated."""
STEP_M = 0.004
"""Smallest depth step behind a border [m]."""


@dataclass(frozen=True)
class Cloud:
    """Points of a surface with unit normals, in one frame."""

    points: np.ndarray  # (N, 3) [m]
    normals: np.ndarray  # (N, 3) towards the camera; for a border: away from the surface's edge, in its plane

    def __len__(self) -> int:
        return len(self.points)

    def some(self, chosen: np.ndarray) -> Cloud:
        """The chosen points, by mask or index."""
        return Cloud(self.points[chosen], self.normals[chosen])

    def moved(self, motion: np.ndarray) -> Cloud:
        """The cloud under a rigid (4, 4) motion."""
        return Cloud(transforms.apply(motion, self.points), self.normals @ motion[:3, :3].T)

    def thinned(self, count: int) -> Cloud:
        """At most `count` points, evenly sampled."""
        return self if len(self) <= count else self.some(np.linspace(0, len(self) - 1, count).astype(int))


@dataclass(frozen=True)
class Eye(DepthView):
    """The camera of a sight, with its depth image."""

    depth: np.ndarray  # (H, W) image-plane z [m]; 0 where nothing was measured
    k: np.ndarray  # (3, 3) [px]
    world_from_camera: np.ndarray  # (4, 4)

    def hides(self, points: np.ndarray, margin: float = 0.012) -> np.ndarray:
        """Which world points (N, 3) are behind the measured depth by `margin` [m], or outside the picture."""
        there, z = self._at(points)
        return np.asarray((there < 0) | ((there > 0) & (there < z - margin)))

    def empty(self, points: np.ndarray) -> float:
        """Fraction of the world points (N, 3) that are in observed empty space: the measured depth is behind them."""
        there, z = self._at(points)
        told = there > 0
        behind = there > z + STEP_M + 4.0 * planes.depth_sigma(np.maximum(z, 0.0))
        return float(behind[told].mean()) if told.any() else 0.0

    def _at(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Measured depth at the pixels of world points (N, 3), -1 outside the picture, and their own z [m]."""
        rows, columns, inside, z = self.find(points)
        return np.where(inside, self.depth[rows, columns], -1.0), z


@dataclass(frozen=True)
class Sight:
    """Measured surface: its points, the borders where it ends, and the noise."""

    inner: Cloud
    border: Cloud
    sigma: float  # standard deviation of a point along its normal [m]
    eye: Eye | None = None  # of the whole sight, before any motion

    def some(self, points: np.ndarray, borders: np.ndarray) -> Sight:
        """The chosen points and borders."""
        return Sight(self.inner.some(points), self.border.some(borders), self.sigma)

    def moved(self, motion: np.ndarray) -> Sight:
        """All of it under a rigid (4, 4) motion."""
        return Sight(self.inner.moved(motion), self.border.moved(motion), self.sigma)

    def thinned(self, points: int, borders: int) -> Sight:
        """At most so many points and borders, evenly sampled."""
        return Sight(self.inner.thinned(points), self.border.thinned(borders), self.sigma)


def of_view(seen: Seen, most: int = MOST) -> Sight:
    """Measured surface of one object, in the world frame [m]."""
    return of_depth(seen.depth, seen.mask, seen.camera.matrix(), seen.world_from_camera, most)


def of_depth(depth: np.ndarray, mask: np.ndarray, k: np.ndarray, world_from_camera: np.ndarray, most: int) -> Sight:
    """Measured pixels of a mask that are on a surface; flying pixels have no plane around them and are dropped.

    Args:
        depth: (H, W) image-plane z [m]; 0 where nothing was measured.
        mask: (H, W) bool.
        k: (3, 3) intrinsics [px].
        world_from_camera: (4, 4) T_world_camera.
        most: Largest number of points.
    """
    from scipy import ndimage

    z = np.where(mask, depth, 0.0).astype(np.float64)
    inverse = np.divide(1.0, z, out=np.zeros_like(z), where=z > 0)
    tolerance = planes.depth_sigma(z) * inverse**2
    fitted = normals.sharpen(normals.fit(inverse, tolerance, WINDOW_PX), inverse, tolerance, WINDOW_PX)
    good = (z > 0) & (fitted.count >= 6) & (np.abs(fitted.c - inverse) < 2.5 * tolerance)
    slope = 1.5 * BAND_PX * z**2 * np.hypot(fitted.a, fitted.b)
    behind = ndimage.maximum_filter(depth, 2 * BAND_PX + 1) - z > STEP_M + 2.0 * planes.depth_sigma(z) + slope
    whole = ndimage.binary_opening(regions.without_pinholes(good), np.ones((3, 3), bool))
    ends = good & whole & behind & ~ndimage.binary_erosion(whole, np.ones((3, 3), bool))
    # The point is taken from the window's plane, which averages the noise of many pixels.
    flat = np.divide(1.0, fitted.c, out=np.zeros_like(z), where=good)
    points = transforms.apply(world_from_camera, cameras.backproject(flat, k))
    facing = fitted.normals(k) @ world_from_camera[:3, :3].T
    noise = (fitted.residual * z**2)[good]
    inner = Cloud(points[good], facing[good]).thinned(most)
    border = _border(transforms.apply(world_from_camera, _edge(depth > 0, whole, ends, fitted, k)), inner)
    sigma = max(5e-4, 1.5 * float(np.median(noise)) if len(noise) else 0.0)
    return Sight(inner, border.thinned(most // 4), sigma, Eye(depth, k, world_from_camera))


def _edge(
    valid: np.ndarray, surface: np.ndarray, ends: np.ndarray, fitted: normals.LocalPlanes, k: np.ndarray
) -> np.ndarray:
    """The edge (N, 3) beyond the border pixels `ends` of a surface, in the camera frame [m].

    Depth is missing in a band on both sides of a step. The edge is in the middle of that band; without this correction,
    faces would appear smaller the more obliquely they are seen.
    """
    from scipy import ndimage

    rows, columns = np.nonzero(ends)
    smooth = np.asarray(ndimage.gaussian_filter(surface.astype(np.float64), 2.0))
    out = -np.stack([np.gradient(smooth, axis=axis)[rows, columns] for axis in (0, 1)], axis=1)
    out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
    limit = np.array(valid.shape)
    gap = np.full(len(rows), 2.0 * BAND_PX)
    for step in range(2 * BAND_PX, 0, -1):
        there = np.round(np.stack([rows, columns], axis=1) + step * out).astype(int)
        inside = ((there >= 0) & (there < limit)).all(axis=1)
        there = np.where(inside[:, None], there, 0)
        gap[inside & valid[there[:, 0], there[:, 1]]] = step - 1.0
    # A shadow of the projector is wider, but on one side only.
    lost = 0.5 * float(np.quantile(gap, 0.4)) if len(gap) else 0.0
    inverse = fitted.at(rows, columns, lost * out[:, 0], lost * out[:, 1])
    near = np.abs(inverse - fitted.c[rows, columns]) < 0.1 * fitted.c[rows, columns]
    z = 1.0 / np.where(near, inverse, fitted.c[rows, columns])
    u, v = columns + np.where(near, lost * out[:, 1], 0.0), rows + np.where(near, lost * out[:, 0], 0.0)
    return cameras.directions(np.stack([u, v], axis=1), k) * z[:, None]


def _border(points: np.ndarray, inner: Cloud, around: int = 10) -> Cloud:
    """Border points with directions away from the surface's edge, across the edge and in the plane of the surface."""
    from scipy.spatial import KDTree

    if len(points) < around or not len(inner):
        return Cloud(np.zeros((0, 3)), np.zeros((0, 3)))
    near = points[KDTree(points).query(points, k=around)[1]]
    offsets = near - near.mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", offsets, offsets))
    # The plane is that of the face that ends here, not of the narrow face of its thickness.
    nearest = KDTree(inner.points).query(points, k=min(FACE, len(inner)))[1].reshape(len(points), -1)
    facing, body = inner.normals[nearest].mean(axis=1), inner.points[nearest].mean(axis=1)
    across = np.cross(vectors[:, :, 2], facing)
    length = np.linalg.norm(across, axis=1)
    across *= (np.sign(((points - body) * across).sum(axis=1)) / np.maximum(length, 1e-9))[:, None]
    straight = (values[:, 2] > 4.0 * values[:, 1]) & (length > 0.5)
    return Cloud(points[straight], across[straight])
