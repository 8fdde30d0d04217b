"""Prepare one view of an object for fitting: trusted points, normals, rays across the silhouette."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import median

import numpy as np

from dextera_build.artifacts.objects.view import Seen
from dextera_build.geometry import cameras, planes, regions, transforms
from dextera_build.geometry.depth_view import DepthView
from dextera_build.geometry.raycast import RayScene

MISFIT = 0.0005
"""Standard deviation of a surface from a fitted body at 1 m, in addition to the noise and like it proportional to the
square of the distance [m/m^2]. With the noise alone, the hidden side of a leaning ellipsoid was fitted worse: its
Chamfer distance was 6.2 instead of 5.2 mm, means of five draws at 0.75 m."""
LEAST_POINTS = 150
"""Minimum number of pixels with trusted depth for a fit."""
REACH_PX = 12.0
"""Extent of the samples on each side of the silhouette [px]."""
CONTACT_M = 0.018
"""Maximum depth difference between an object and the surface visible just below it that carries it [m]."""
LIFTED_M = 0.02
"""Maximum height of the lowest seen border of an object that stands on the support [m]."""
STEEPEST = 0.3
"""Change of height over the size of a pixel below which a surface is level; of an upright one it is over 0.4."""
STEP_PX = 0.75
"""Spacing of the rays across the silhouette [px]."""
COARSE = 4
"""Every so many rays across the silhouette, one is cast first; it divides their number less one."""
STEP_M, STEP_SIGMAS = 0.006, 4.0
"""Depth difference above which two surfaces are apart: [m], and in addition in standard deviations."""


@dataclass(frozen=True)
class Silhouette:
    """Rays across the outline of the mask, from inside to outside."""

    rays: np.ndarray  # (S, T, 6) origin and direction in the world frame
    inside: np.ndarray  # (S, T) bool, beyond the far side of the body; treated as covered
    outside: np.ndarray  # (S, T) bool, beyond a gap in the mask; treated as empty

    def met(self, body: RayScene) -> np.ndarray:
        """Whether each ray meets a body, (S, T) bool; a part or a gap that lies between every fourth ray is not seen.

        Most rays are far from the border of the body, and fits ask a thousand times.
        """
        sparse, between = self._split
        ends = body.occluded(sparse, np.inf)
        found = np.repeat(ends, COARSE, axis=1)[:, : self.rays.shape[1]]
        place, part = np.nonzero(ends[:, 1:] != ends[:, :-1])
        inner = found[:, :-1].reshape(len(found), -1, COARSE)
        inner[place, part, 1:] = body.occluded(between[place, part], np.inf)
        found[:, :-1] = inner.reshape(len(found), -1)
        return found

    @cached_property
    def _split(self) -> tuple[np.ndarray, np.ndarray]:
        """Float32 rays (S, T / COARSE + 1, 6) at even intervals, and those inside, (S, T / COARSE, COARSE - 1, 6)."""
        rays = self.rays.astype(np.float32)
        inner = rays[:, :-1].reshape(len(rays), -1, COARSE, 6)[:, :, 1:]
        return np.ascontiguousarray(rays[:, ::COARSE]), np.ascontiguousarray(inner)


@dataclass(frozen=True)
class Evidence(DepthView):
    """One object seen by one camera. Points and rays are in the world frame; the object stands on z = 0."""

    base: float  # height above the support of the surface under the object [m]; 0 for the support itself
    k: np.ndarray  # (3, 3) intrinsics of the crop [px]
    world_from_camera: np.ndarray  # (4, 4)
    mask: np.ndarray  # (H, W) bool
    known: np.ndarray  # (H, W) bool, not hidden by anything nearer
    depth: np.ndarray  # (H, W) float64 [m], 0 if not measured
    sigma: np.ndarray  # (H, W) float64, standard deviation of the depth from a body's [m]: noise and misfit
    core: np.ndarray  # (H, W) bool, mask pixels with trusted depth
    points: np.ndarray  # (N, 3) world points of the core, row-major [m]
    normals: np.ndarray  # (N, 3) unit normals that face the camera
    rays: np.ndarray  # (P, 6) rays through a sample of the core
    ray_depth: np.ndarray  # (P,) seen depth of the rays [m]
    ray_sigma: np.ndarray  # (P,) standard deviation of the depth [m]
    silhouette: Silhouette
    others: tuple[Evidence, ...] = ()  # the same object in further photographs; points and rays above include theirs

    @cached_property
    def fitted_rays(self) -> np.ndarray:
        """Rays (P, 6) float32 of which a fit asks the depth."""
        return self.rays.astype(np.float32)

    @property
    def point_sigma(self) -> np.ndarray:
        """Standard deviation (N,) of the depth of every point of the core [m], noise alone."""
        own = planes.depth_sigma(self.depth[self.core])
        return np.concatenate([own, *(other.point_sigma for other in self.others)]) if self.others else own

    @property
    def eye(self) -> np.ndarray:
        """The camera's position (3,) in the world [m]."""
        return np.asarray(self.world_from_camera[:3, 3])

    @property
    def forward(self) -> np.ndarray:
        """Unit horizontal direction (2,) from the camera to the object."""
        towards = np.median(self.points[:, :2], axis=0) - self.eye[:2]
        length = float(np.linalg.norm(towards))
        return towards / length if length > 1e-9 else np.array([0.0, 1.0])

    @property
    def height(self) -> float:
        """Height of the highest trusted points above the support, robust to outliers [m]."""
        return max(float(np.quantile(self.points[:, 2], 0.995)), 0.004)


def gather(seen: Seen, samples: int = 1500, outline_samples: int = 220) -> Evidence:
    """Prepare a view for fitting.

    Args:
        seen: The view.
        samples: Number of depth rays per fit.
        outline_samples: Number of silhouette samples per fit.
    """
    if not seen.others:
        return _of_one(seen, samples, outline_samples)
    count = 1 + len(seen.others)
    first, *others = (_of_one(one, samples // count, outline_samples // count) for one in (seen, *seen.others))
    return joined(first, [_based(other, first.base) for other in others])


def joined(first: Evidence, others: Sequence[Evidence]) -> Evidence:
    """The evidence of several photographs; masks, depth and camera are those of the first one."""
    every = (first, *others)
    outlines = [one.silhouette for one in every]

    def stacked(name: str) -> np.ndarray:
        return np.concatenate([getattr(one, name) for one in every])

    return replace(
        first,
        points=stacked("points"),
        normals=stacked("normals"),
        rays=stacked("rays"),
        ray_depth=stacked("ray_depth"),
        ray_sigma=stacked("ray_sigma"),
        silhouette=Silhouette(
            *(np.concatenate([getattr(one, name) for one in outlines]) for name in ("rays", "inside", "outside"))
        ),
        others=tuple(others),
    )


def _based(one: Evidence, base: float) -> Evidence:
    """A view's evidence in the world whose z = 0 is at the height `base` [m], which the first photograph gives."""
    drop = np.array([0.0, 0.0, base - one.base])
    pose = one.world_from_camera.copy()
    pose[:3, 3] -= drop
    six = np.append(drop, np.zeros(3))
    return replace(
        one,
        base=base,
        world_from_camera=pose,
        points=one.points - drop,
        rays=one.rays - six,
        silhouette=replace(one.silhouette, rays=one.silhouette.rays - six),
    )


def _of_one(seen: Seen, samples: int, outline_samples: int) -> Evidence:
    """The evidence of one photograph."""
    k, pose = seen.camera.matrix(), seen.world_from_camera
    mask = regions.without_pinholes(seen.mask)
    depth = seen.depth.astype(np.float64)
    sigma = planes.depth_sigma(depth) + MISFIT * np.square(depth)
    known = ~_grown(seen.occluder, 2)
    core = trusted(mask, depth, sigma) & known
    normals = _normals(np.where(core, depth, 0.0), k)
    base = standing_height(mask, depth, k, pose)
    pose = pose.copy()
    pose[2, 3] -= base
    points = transforms.apply(pose, cameras.backproject(depth, k)[core])
    bearings = _bearings(depth.shape, k, pose)
    chosen = np.flatnonzero(core.ravel())
    chosen = chosen[:: max(1, len(chosen) // samples)]
    return Evidence(
        base=base,
        k=k,
        world_from_camera=pose,
        mask=mask,
        known=known,
        depth=depth,
        sigma=sigma,
        core=core,
        points=points,
        normals=normals[core] @ pose[:3, :3].T,
        rays=bearings.reshape(-1, 6)[chosen],
        ray_depth=depth.ravel()[chosen],
        ray_sigma=sigma.ravel()[chosen],
        silhouette=_silhouette(mask, known, k, pose, outline_samples),
    )


def standing_height(mask: np.ndarray, depth: np.ndarray, k: np.ndarray, pose: np.ndarray) -> float:
    """Height above the support of the surface under the object [m], 0 unless the view shows otherwise.

    Along the lower border of the mask, an object on top of another touches the surface seen below it; an occluded
    object is behind that surface. A level surface gives its height directly; an edge gives only that of the object
    above it. Where something nearer and higher begins just below all of the border, what carries it is hidden.
    """
    columns = np.flatnonzero((mask & (depth > 0)).any(axis=0))
    if len(columns) < 8:
        return 0.0
    lowest = len(mask) - 1 - np.argmax(mask[::-1, columns], axis=0)
    height, rise, touching, told, asked = np.full(len(columns), np.nan), np.full(len(columns), np.nan), 0, 0, 0
    ground = np.full(len(columns), np.nan)
    heights = transforms.apply(pose, cameras.backproject(depth, k))[..., 2]
    for i, (column, row) in enumerate(zip(columns, lowest, strict=True)):
        above, below = np.s_[max(row - 6, 0) : row - 1, column], np.s_[row + 3 : row + 7, column]
        if not ((depth[above] > 0).any() and (depth[below] > 0).any()):
            continue
        (top, seen_top), (under, seen_under) = (_middle(depth[at], heights[at]) for at in (above, below))
        before = np.s_[row + 9 : row + 13, column]
        near, seen_near = _middle(depth[before], heights[before]) if (depth[before] > 0).any() else (0.0, np.nan)
        # Hidden from here on: the strip below may be the object's own foot, mixed with what hides it.
        told += not (near < under - CONTACT_M and seen_near > seen_top + LIFTED_M)
        asked += 1
        if abs(top - under) < CONTACT_M and seen_under > 0.6 * LIFTED_M:
            touching += 1
            height[i] = seen_top
            if near:
                ground[i] = seen_under
                rise[i] = (seen_under - seen_near) / (6 * under / k[1, 1])
    if told < 8 or touching < 0.6 * asked:
        return 0.0
    level = np.isfinite(ground).sum() >= 8 and abs(float(np.nanmedian(rise))) < STEEPEST
    base = float(np.nanmedian(ground)) if level else float(np.nanquantile(height, 0.1))
    return base if base > LIFTED_M else 0.0


def _middle(depth: np.ndarray, heights: np.ndarray) -> tuple[float, float]:
    """Median depth and height of the pixels with a depth."""
    there = depth > 0
    return median(depth[there].tolist()), median(heights[there].tolist())


def step(sigma: np.ndarray) -> np.ndarray:
    """Depth difference above which two surfaces are apart [m], from the standard deviation of their depth."""
    return STEP_M + STEP_SIGMAS * sigma


def trusted(mask: np.ndarray, depth: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Mask pixels away from the outline, gaps and depth jumps, which excludes flying pixels."""
    from scipy import ndimage

    inner = ndimage.binary_erosion(mask, iterations=2) & (depth > 0)
    high = ndimage.maximum_filter(np.where(depth > 0, depth, -np.inf), 3)
    low = ndimage.minimum_filter(np.where(depth > 0, depth, np.inf), 3)
    return np.asarray(inner & (high - low < step(sigma)))


def _grown(mask: np.ndarray, pixels: int) -> np.ndarray:
    from scipy import ndimage

    return np.asarray(ndimage.binary_dilation(mask, iterations=pixels)) if mask.any() else mask


def _bearings(shape: tuple[int, ...], k: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Rays (H, W, 6) in the world frame whose parameter is the image-plane depth."""
    directions = cameras.rays(shape[0], shape[1], k) @ pose[:3, :3].T
    return np.concatenate([np.broadcast_to(pose[:3, 3], directions.shape), directions], axis=-1)


def _normals(depth: np.ndarray, k: np.ndarray, window: int = 7) -> np.ndarray:
    """Unit normals (H, W, 3) in the camera frame, smoothed, facing the camera; 0 if unknown."""
    from scipy import ndimage

    points = cameras.backproject(depth, k)
    valid = (depth > 0).astype(np.float64)
    weight = np.maximum(ndimage.uniform_filter(valid, window), 1e-6)
    middle = np.stack([ndimage.uniform_filter(points[..., i] * valid, window) / weight for i in range(3)], axis=-1)
    columns, rows = np.indices(depth.shape)[::-1].astype(np.float64)
    slopes = []
    # Least-squares slopes of depth over the window, ignoring gaps: a normal needs no full window.
    mean = [ndimage.uniform_filter(q * valid, window) / weight for q in (columns, rows, depth)]
    moment = {
        (i, j): ndimage.uniform_filter(p * q * valid, window) / weight - mean[i] * mean[j]
        for i, p in enumerate((columns, rows, depth))
        for j, q in enumerate((columns, rows, depth))
        if i <= j and i < 2
    }
    determinant = moment[0, 0] * moment[1, 1] - moment[0, 1] ** 2
    safe = np.where(determinant > 1e-6, determinant, np.inf)
    slopes.append((moment[0, 2] * moment[1, 1] - moment[1, 2] * moment[0, 1]) / safe)
    slopes.append((moment[1, 2] * moment[0, 0] - moment[0, 2] * moment[0, 1]) / safe)
    z = np.maximum(mean[2], 1e-6)
    along_u = np.stack([z / k[0, 0] + middle[..., 0] / z * slopes[0], middle[..., 1] / z * slopes[0], slopes[0]], -1)
    along_v = np.stack([middle[..., 0] / z * slopes[1], z / k[1, 1] + middle[..., 1] / z * slopes[1], slopes[1]], -1)
    normal = np.cross(along_v, along_u)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    return np.asarray(normal)


def _silhouette(mask: np.ndarray, known: np.ndarray, k: np.ndarray, pose: np.ndarray, samples: int) -> Silhouette:
    outline, outward = _outline(mask, samples)
    offsets = np.arange(-REACH_PX, REACH_PX + STEP_PX / 2, STEP_PX)
    places = outline[:, None, :] + offsets[None, :, None] * outward[:, None, :]
    inner, beyond = _lookup(mask, places), ~_lookup(np.ones_like(mask), places)
    hidden = (~_lookup(known, places, outside=True) | beyond) & (offsets > 0)
    keep = ~hidden[:, (offsets > 0) & (offsets <= 4.0)].any(axis=1)
    places, inner = places[keep], inner[keep]
    # Inwards from the outline the mask must be unbroken, outwards empty; samples behind a break are ignored.
    inward = offsets < -0.75
    broken = np.cumsum((~inner & inward)[:, ::-1], axis=1)[:, ::-1] > 0
    again = np.cumsum(inner & (offsets > 1.5), axis=1) > 0
    directions = cameras.directions(places, k) @ pose[:3, :3].T
    rays = np.concatenate([np.broadcast_to(pose[:3, 3], directions.shape), directions], axis=-1)
    return Silhouette(rays, broken & inward, again)


def _lookup(mask: np.ndarray, places: np.ndarray, *, outside: bool = False) -> np.ndarray:
    """Values (...,) of a mask at positions (..., 2) (column, row); `outside` is the value beyond the border."""
    nearest = np.round(places).astype(int)
    height, width = mask.shape
    within = (nearest >= 0).all(axis=-1) & (nearest[..., 0] < width) & (nearest[..., 1] < height)
    clipped = np.clip(nearest, 0, [width - 1, height - 1])
    return np.where(within, mask[clipped[..., 1], clipped[..., 0]], outside)


def _outline(mask: np.ndarray, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Evenly spaced positions (S, 2) (column, row) on the mask's border and unit outward directions (S, 2)."""
    import cv2
    from scipy import ndimage

    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    contours = [contour[:, 0].astype(np.float64) for contour in contours if len(contour) >= 24]
    total = sum(len(contour) for contour in contours)
    places, outward = [], []
    for contour in contours:
        smooth = ndimage.gaussian_filter1d(contour, 2.0, axis=0, mode="wrap")
        tangent = np.roll(smooth, -1, axis=0) - np.roll(smooth, 1, axis=0)
        normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=-1)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
        # The outward side differs between outer borders and holes: sample the mask.
        probe = _lookup(mask, smooth + 2.5 * normal).mean() - _lookup(mask, smooth - 2.5 * normal).mean()
        normal = normal if probe < 0 else -normal
        pick = np.linspace(0, len(contour), max(8, samples * len(contour) // max(total, 1)), endpoint=False).astype(int)
        # Contour pixels of holes belong to the mask as well, so both kinds are half a pixel inside.
        places.append(smooth[pick] + 0.5 * normal[pick])
        outward.append(normal[pick])
    if not places:
        return np.zeros((0, 2)), np.zeros((0, 2))
    return np.concatenate(places), np.concatenate(outward)
