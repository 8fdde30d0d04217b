"""The sensor of an RGB-D camera: noise, holes, quantisation, added to ideal pictures.

Depth is modelled after a stereo camera with projector (Intel RealSense D435): the standard deviation of z is
z^2 * subpixel / (focal * baseline), because the error is constant in disparity; neighbouring pixels share a matching
window, so their errors are correlated.
"""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.robots.noise import ColourNoise, DepthNoise

DARK, SHINE = 0.2, 0.98
"""Mean of sRGB 0..1 below which surfaces return too little of the projector's light, and above which they saturate."""
PATCH_PX = 4.0
"""Standard deviation of the blur from which patches are cut [px]."""


def measure_depth(
    depth: np.ndarray, rgb: np.ndarray, k: np.ndarray, options: DepthNoise, rng: np.random.Generator
) -> np.ndarray:
    """Simulate measured depth: (H, W) float32 [m], 0 if not measured.

    Args:
        depth: (H, W) true image-plane z [m], 0 if empty.
        rgb: (H, W, 3) the noise-free picture, sRGB 0..1.
        k: (3, 3) intrinsics [px].
        options: Noise parameters.
        rng: Source of all randomness.
    """
    sigma = depth**2 * options.subpixel_px / (options.focal_px * options.baseline_m)
    noisy = depth + sigma * _correlated(depth.shape, options.correlation_px, rng)
    chance = rng.uniform(size=depth.shape)
    lost = (depth < options.nearest_m) | (depth > options.farthest_m)
    edge = edges(depth, options.edge_px, options.edge_step)
    lost |= edge & (chance < options.edge_loss)
    lost |= chance > 1.0 - options.dropout
    lost |= facing(depth, k) < np.cos(np.radians(options.grazing_deg))
    lost |= _patches(depth.shape, _loss(rgb, options), rng)
    if options.smear > 0:
        noisy = np.where(edge & (rng.uniform(size=depth.shape) < options.smear), _between(noisy, options, rng), noisy)
    counts = np.round(noisy / options.step_m)
    return np.asarray(np.where(lost, 0.0, counts * options.step_m), np.float32)


def measure_colour(rgb: np.ndarray, options: ColourNoise, rng: np.random.Generator) -> np.ndarray:
    """Simulate measured colours: (H, W, 3) uint8 from (H, W, 3) float64 sRGB 0..1."""
    height, width = rgb.shape[:2]
    row, column = np.mgrid[0:height, 0:width] - np.array([[[(height - 1) / 2]], [[(width - 1) / 2]]])
    corner = (row**2 + column**2) / ((height / 2) ** 2 + (width / 2) ** 2)
    dimmed = rgb * (1.0 - options.vignetting * corner)[..., None]
    noise = rng.standard_normal(rgb.shape) * options.sigma * np.sqrt(np.clip(dimmed, 0.02, 1) / 0.5)
    return np.asarray(np.round(np.clip(dimmed + noise, 0, 1) * 255), np.uint8)


def edges(depth: np.ndarray, width: int, step: float) -> np.ndarray:
    """Pixels (H, W) bool within `width` of a relative depth step larger than `step` between neighbours."""
    found = np.zeros(depth.shape, bool)
    for axis in (0, 1):
        near = np.minimum(depth.take(range(depth.shape[axis] - 1), axis), depth.take(range(1, depth.shape[axis]), axis))
        jump = np.abs(np.diff(depth, axis=axis)) > step * np.maximum(near, 1e-9)
        found |= np.pad(jump, [(0, int(axis == 0)), (0, int(axis == 1))])
        found |= np.pad(jump, [(int(axis == 0), 0), (int(axis == 1), 0)])
    for _ in range(width - 1):
        grown = found.copy()
        grown[1:] |= found[:-1]
        grown[:-1] |= found[1:]
        grown[:, 1:] |= found[:, :-1]
        grown[:, :-1] |= found[:, 1:]
        found = grown
    return found


def facing(depth: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Cosine (H, W) of the angle between each pixel's ray and the surface's normal, from neighbours; 0 if empty.

    With the point P = z (x, y, 1), differences of neighbours are dP/du = (m / fx + x z_u, y z_u, z_u), where m is the
    mean of both depths, and dP/dv alike; the product of their cross product with the ray (x, y, 1) is m m' / (fx fy).
    """
    (fx, fy), (cx, cy) = (k[0, 0], k[1, 1]), k[:2, 2]
    x, y = (np.arange(depth.shape[1]) - cx) / fx, ((np.arange(depth.shape[0]) - cy) / fy)[:, None]
    right, across = np.gradient(depth, axis=1), _between_neighbours(depth, 1) / fx
    down, along = np.gradient(depth, axis=0), _between_neighbours(depth, 0) / fy
    head_on = across * along
    square = np.square(right * along) + np.square(across * down)
    square += np.square(head_on + across * y * down + x * right * along)
    length = np.sqrt(square * (x**2 + y**2 + 1.0))
    return np.asarray(np.where(depth > 0, np.abs(head_on) / np.maximum(length, 1e-18), 0.0))


def _between_neighbours(depth: np.ndarray, axis: int) -> np.ndarray:
    """Mean of the two neighbours along an axis (H, W), and the only one at the border, as `np.gradient` takes them."""
    z = np.moveaxis(depth, axis, 0)
    mean = np.empty_like(z)
    mean[1:-1] = (z[2:] + z[:-2]) / 2
    mean[0], mean[-1] = z[1], z[-2]
    return np.moveaxis(mean, 0, axis)


def _loss(rgb: np.ndarray, options: DepthNoise) -> np.ndarray:
    """Fraction (H, W) of depth lost in patches: everywhere, on dark surfaces, and on bright ones."""
    light = rgb.mean(axis=-1)
    dark = options.dark_loss * np.clip(1.0 - light / DARK, 0.0, 1.0)
    return np.asarray(
        np.maximum.reduce([np.full(light.shape, options.patches), dark, options.shine_loss * (light > SHINE)])
    )


def _patches(shape: tuple[int, ...], loss: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Pixels (H, W) bool, in patches that cover the fraction `loss` (H, W) of their surroundings."""
    if not loss.any():
        return np.zeros(shape, bool)
    from scipy import ndimage, special

    smooth = ndimage.gaussian_filter(rng.standard_normal(shape), PATCH_PX)
    return np.asarray(special.ndtr(smooth / smooth.std()) < loss)


def _between(depth: np.ndarray, options: DepthNoise, rng: np.random.Generator) -> np.ndarray:
    """Depths (H, W) drawn between the nearest and the farthest in a pixel's neighbourhood."""
    from scipy import ndimage

    size = 2 * options.edge_px + 1
    near, far = ndimage.minimum_filter(depth, size), ndimage.maximum_filter(depth, size)
    return np.asarray(near + (far - near) * rng.uniform(size=depth.shape))


def _correlated(shape: tuple[int, ...], width: int, rng: np.random.Generator) -> np.ndarray:
    white = rng.standard_normal((shape[0] + width - 1, shape[1] + width - 1))
    total = sum(white[i : i + shape[0], j : j + shape[1]] for i in range(width) for j in range(width))
    return np.asarray(total) / width
