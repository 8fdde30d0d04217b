"""Metrics between a reconstruction and a truth: masks, colours, depth, surfaces (paper, Table II).

Masks and pictures are (H, W[, 3]) of one camera, surfaces are triangles in one frame; lengths in metres.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry.colour import to_linear

RGB_TO_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
"""Linear sRGB to CIE XYZ, D65 white (IEC 61966-2-1)."""


def mask_iou(one: np.ndarray, other: np.ndarray) -> float:
    """Intersection over union of two masks; 0 if both are empty."""
    either = int((one | other).sum())
    return int((one & other).sum()) / either if either else 0.0


def boundary(mask: np.ndarray) -> np.ndarray:
    """Pixels (H, W) bool that differ from their right, lower or lower right neighbour, as DAVIS defines it."""
    padded = np.pad(mask, ((0, 1), (0, 1)), mode="edge")
    here = padded[:-1, :-1]
    return np.asarray((here ^ padded[:-1, 1:]) | (here ^ padded[1:, :-1]) | (here ^ padded[1:, 1:]))


def boundary_tolerance(shape: tuple[int, int], tolerance: float) -> float:
    """Tolerance in pixels: a number below 1 is a fraction of the image diagonal, rounded up, as in DAVIS."""
    return float(np.ceil(tolerance * np.hypot(*shape))) if tolerance < 1 else float(tolerance)


def boundary_f1(found: np.ndarray, truth: np.ndarray, tolerance: float = 0.008) -> float:
    """F-measure of two masks' boundaries (Perazzi et al. 2016): fractions of each within the tolerance of the other.

    Args:
        found: (H, W) bool.
        truth: (H, W) bool.
        tolerance: Pixels, or below 1 a fraction of the diagonal.
    """
    from scipy.ndimage import distance_transform_edt

    radius = boundary_tolerance((truth.shape[0], truth.shape[1]), tolerance)
    edge_found, edge_truth = boundary(found), boundary(truth)
    if not edge_found.any() or not edge_truth.any():
        return float(not edge_found.any() and not edge_truth.any())
    precision = float((distance_transform_edt(~edge_truth)[edge_found] <= radius).mean())
    recall = float((distance_transform_edt(~edge_found)[edge_truth] <= radius).mean())
    return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


def rgb_mae(one: np.ndarray, other: np.ndarray, where: np.ndarray) -> float | None:
    """Mean absolute difference of sRGB values 0..1 over `where`; None if `where` is empty."""
    if not where.any():
        return None
    return float(np.abs(one[where].astype(np.float64) - other[where].astype(np.float64)).mean() / 255.0)


def psnr(one: np.ndarray, other: np.ndarray, where: np.ndarray) -> float | None:
    """Peak signal-to-noise ratio [dB] of sRGB uint8 pictures over `where`; None if it is empty or they are equal."""
    apart = one[where].astype(np.float64) - other[where].astype(np.float64)
    if not apart.any():
        return None
    return 10.0 * float(np.log10(255.0**2 / (apart**2).mean()))


def lab(pixels: np.ndarray) -> np.ndarray:
    """CIE L*a*b* (..., 3) float32 (L 0..100) of sRGB uint8, D65 white."""
    srgb = pixels.astype(np.float64) / 255.0
    linear = to_linear(srgb)
    ratio = linear @ RGB_TO_XYZ.T / RGB_TO_XYZ.sum(axis=1)
    f = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio / (3 * (6 / 29) ** 2) + 4 / 29)
    x, y, z = f[..., 0], f[..., 1], f[..., 2]
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1).astype(np.float32)


def delta_e76(one: np.ndarray, other: np.ndarray, where: np.ndarray) -> float | None:
    """Mean CIE 1976 colour difference of sRGB uint8 pictures over `where`; None if `where` is empty."""
    if not where.any():
        return None
    return float(np.linalg.norm(lab(one[where]) - lab(other[where]), axis=-1).mean())


def depth_mae(one: np.ndarray, other: np.ndarray, where: np.ndarray) -> float | None:
    """Mean absolute depth difference [m] over `where`, where both are valid (not 0); None if there is no such pixel."""
    errors = depth_errors(one, other, where)
    return None if errors is None else errors.mae


def face_areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Areas (F,) of triangles [m^2]."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)


def surface_centroid(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Centroid (3,) of a surface, weighted by area [m]."""
    areas = face_areas(vertices, faces)
    return np.asarray((vertices[faces].mean(axis=1) * areas[:, None]).sum(axis=0) / areas.sum())


def sample_surface(vertices: np.ndarray, faces: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Points (count, 3) float64 sampled uniformly on a surface."""
    rng = np.random.default_rng(seed)
    edges = np.cumsum(face_areas(vertices, faces))
    # Stratified: one point in each of `count` equal shares of the area, so that no small face is missed by chance.
    spots = (np.arange(count) + rng.uniform(size=count)) / count * edges[-1]
    corners = vertices[faces[np.minimum(np.searchsorted(edges, spots), len(faces) - 1)]]
    root, second = np.sqrt(rng.uniform(size=(count, 1))), rng.uniform(size=(count, 1))
    weights = np.concatenate([1 - root, root * (1 - second), root * second], axis=1)
    return np.asarray((corners * weights[..., None]).sum(axis=1))


def nearest(points: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Distance (N,) of each point to the nearest target [m]."""
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(targets).query(points)[0])


def chamfer_and_f(found: np.ndarray, truth: np.ndarray, threshold_m: float) -> tuple[float, float]:
    """Chamfer-L1 [m] and F-score of two point sets.

    Chamfer-L1 is half the sum of both mean nearest distances; the F-score is the harmonic mean of the parts of each
    set within `threshold_m` of the other.
    """
    there, back = nearest(found, truth), nearest(truth, found)
    precision, recall = float((there < threshold_m).mean()), float((back < threshold_m).mean())
    score = 2 * precision * recall / (precision + recall) if precision + recall else 0.0
    return float((there.mean() + back.mean()) / 2), score


def match(overlaps: np.ndarray, least: float) -> list[tuple[int, int]]:
    """Pairs (row, column) with the largest total overlap, one to one, each at least `least` (Hungarian method)."""
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(-overlaps)
    return [(int(r), int(c)) for r, c in zip(rows, columns, strict=True) if overlaps[r, c] >= least]


def mean_std(values: Iterable[float | None]) -> tuple[float | None, float | None, int]:
    """Mean, sample standard deviation (None below two values) and count of the values that are not None."""
    known = np.array([value for value in values if value is not None], np.float64)
    if not len(known):
        return None, None, 0
    return float(known.mean()), float(known.std(ddof=1)) if len(known) > 1 else None, len(known)


def ssim(one: np.ndarray, other: np.ndarray, where: np.ndarray) -> float | None:
    """Mean structural similarity of two sRGB uint8 pictures (H, W, 3) over `where`; None if `where` is empty.

    Wang et al. 2004 with their Gaussian window (11 x 11, standard deviation 1.5 px) and constants, mean of the three
    channels. Windows extend beyond the border of `where`, so both pictures need values there.
    """
    from scipy.ndimage import gaussian_filter

    if not where.any():
        return None
    a, b = one.astype(np.float64), other.astype(np.float64)

    def smooth(values: np.ndarray) -> np.ndarray:
        return np.asarray(gaussian_filter(values, (1.5, 1.5, 0.0), truncate=10 / 3))

    mean_a, mean_b = smooth(a), smooth(b)
    variances = smooth(a * a) - mean_a**2 + smooth(b * b) - mean_b**2
    covariance = smooth(a * b) - mean_a * mean_b
    first, second = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    index = (2 * mean_a * mean_b + first) * (2 * covariance + second)
    index /= (mean_a**2 + mean_b**2 + first) * (variances + second)
    return float(index.mean(axis=-1)[where].mean())


@dataclass(frozen=True)
class DepthErrors:
    """Errors of a depth map against a true one, over the pixels where both are valid."""

    mae: float
    """Mean absolute difference [m]."""
    rmse: float
    """Root mean square difference [m]."""
    median: float
    """Median absolute difference [m]."""
    abs_rel: float
    """Mean relative difference to the true depth."""
    delta1: float
    """Fraction with a ratio below 1.25."""


def depth_errors(found: np.ndarray, truth: np.ndarray, where: np.ndarray) -> DepthErrors | None:
    """Depth errors over `where`, where both are valid (not 0); None if there is no such pixel (Eigen et al. 2014)."""
    both = where & (found > 0) & (truth > 0)
    if not both.any():
        return None
    a, b = found[both].astype(np.float64), truth[both].astype(np.float64)
    apart = np.abs(a - b)
    return DepthErrors(
        mae=float(apart.mean()),
        rmse=float(np.sqrt((apart**2).mean())),
        median=float(np.median(apart)),
        abs_rel=float((apart / b).mean()),
        delta1=float((np.maximum(a / b, b / a) < 1.25).mean()),
    )
