"""Points with normals, and borders, of what a depth camera saw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.view import Seen
from dextera_build.geometry import cameras, normals, planes, regions, transforms

MOST = 5000
"""Points of a cloud that take part; more change no estimate, because neighbours share their errors."""
WINDOW_PX = 3
"""Half width of the window that a normal is fitted to [px]."""
BAND_PX = 5
"""Width of the band along a border in which depth may be lost [px]."""
FACE = 40
"""Number of surface points next to a border that tell how its face lies."""
STEP_M = 0.004
"""Least step of depth behind a border [m]."""


@dataclass(frozen=True)
class Cloud:
    """Points of a surface with unit normals, in one frame."""

    points: np.ndarray  # (N, 3) [m]
    normals: np.ndarray  # (N, 3) towards the camera; of a border: out of the surface's edge, along the surface

    def __len__(self) -> int:
        return len(self.points)

    def some(self, chosen: np.ndarray) -> Cloud:
        """The chosen points, by mask or index."""
        return Cloud(self.points[chosen], self.normals[chosen])

    def moved(self, motion: np.ndarray) -> Cloud:
        """The cloud under a rigid (4, 4) motion."""
        return Cloud(transforms.apply(motion, self.points), self.normals @ motion[:3, :3].T)

    def thinned(self, count: int) -> Cloud:
        """At most `count` points, evenly taken."""
        return self if len(self) <= count else self.some(np.linspace(0, len(self) - 1, count).astype(int))


@dataclass(frozen=True)
class Eye:
    """The camera of a sight, with the depth image that it took."""

    depth: np.ndarray  # (H, W) image-plane z [m]; 0 where nothing was measured
    k: np.ndarray  # (3, 3) [px]
    world_from_camera: np.ndarray  # (4, 4)

    def hides(self, points: np.ndarray, margin: float = 0.012) -> np.ndarray:
        """Which world points (N, 3) are behind what was measured, by `margin` [m], or out of the picture."""
        local = transforms.apply(transforms.invert(self.world_from_camera), points)
        rows, columns, inside = cameras.nearest_pixels(local, self.k, self.depth.shape)
        there = np.where(inside, self.depth[np.where(inside, rows, 0), np.where(inside, columns, 0)], 0.0)
        return np.asarray(~inside | ((there > 0) & (there < local[:, 2] - margin)))


@dataclass(frozen=True)
class Sight:
    """What was measured of a surface: its points, the borders where it ends, and the noise."""

    inner: Cloud
    border: Cloud
    sigma: float  # standard deviation of a point along its normal [m]
    eye: Eye | None = None  # of a whole sight that was not moved

    def some(self, points: np.ndarray, borders: np.ndarray) -> Sight:
        """The chosen points and borders."""
        return Sight(self.inner.some(points), self.border.some(borders), self.sigma)

    def moved(self, motion: np.ndarray) -> Sight:
        """All of it under a rigid (4, 4) motion."""
        return Sight(self.inner.moved(motion), self.border.moved(motion), self.sigma)

    def thinned(self, points: int, borders: int) -> Sight:
        """At most so many points and borders."""
        return Sight(self.inner.thinned(points), self.border.thinned(borders), self.sigma)


def of_view(seen: Seen, most: int = MOST) -> Sight:
    """What was measured of one object, in the world frame [m]."""
    return of_depth(seen.depth, seen.mask, seen.camera.matrix(), seen.world_from_camera, most)


def of_depth(depth: np.ndarray, mask: np.ndarray, k: np.ndarray, world_from_camera: np.ndarray, most: int) -> Sight:
    """Measured pixels of a mask that lie on a surface: flying pixels have no plane around them.

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
    ends = good & behind & ~ndimage.binary_erosion(regions.without_pinholes(good), np.ones((3, 3), bool))
    # The window's plane, not the reading, gives the point: its noise is that of many pixels.
    flat = np.divide(1.0, fitted.c, out=np.zeros_like(z), where=good)
    points = transforms.apply(world_from_camera, cameras.backproject(flat, k))
    facing = fitted.normals(k) @ world_from_camera[:3, :3].T
    noise = (fitted.residual * z**2)[good]
    inner = Cloud(points[good], facing[good]).thinned(most)
    border = _border(points[ends], inner)
    sigma = max(5e-4, 1.5 * float(np.median(noise)) if len(noise) else 0.0)
    return Sight(inner, border.thinned(most // 4), sigma, Eye(depth, k, world_from_camera))


def _border(points: np.ndarray, inner: Cloud, around: int = 10) -> Cloud:
    """Border points with directions out of the surface's edge, across the edge and along the surface."""
    from scipy.spatial import KDTree

    if len(points) < around or not len(inner):
        return Cloud(np.zeros((0, 3)), np.zeros((0, 3)))
    near = points[KDTree(points).query(points, k=around)[1]]
    offsets = near - near.mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", offsets, offsets))
    # The face that ends here, not the narrow one of its thickness, says what is along the surface.
    nearest = KDTree(inner.points).query(points, k=min(FACE, len(inner)))[1].reshape(len(points), -1)
    facing, body = inner.normals[nearest].mean(axis=1), inner.points[nearest].mean(axis=1)
    across = np.cross(vectors[:, :, 2], facing)
    length = np.linalg.norm(across, axis=1)
    across *= (np.sign(((points - body) * across).sum(axis=1)) / np.maximum(length, 1e-9))[:, None]
    straight = (values[:, 2] > 4.0 * values[:, 1]) & (length > 0.5)
    return Cloud(points[straight], across[straight])
