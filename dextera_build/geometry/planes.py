"""Planes in noisy depth data: fits, random sampling, and a noise model of depth cameras.

A plane is a pair (normal, offset) with unit normal n and n . p + offset = 0 for its points p.
"""

from __future__ import annotations

import numpy as np

Plane = tuple[np.ndarray, float]
NOISY = 5.0
"""Ratio of the noise between neighbouring pixels to that of the noise model above which depth is only noise.

Real captures had up to 0.1.
"""


def depth_sigma(z: np.ndarray) -> np.ndarray:
    """Standard deviation of a depth camera's z at depth `z`, both [m]: the noise model of all rules.

    Triangulating cameras (structured light, active stereo) lose accuracy with z^2. 1.5 mm/m^2 is the random error of
    the first Kinect (Khoshelham and Oude Elberink 2012: 1.42e-3); the constant is the 1 mm step of stored depth.
    """
    return np.asarray(0.001 + 0.0015 * np.square(z))


def pixel_noise(depth: np.ndarray) -> float:
    """Standard deviation of a depth image (H, W) [m] between neighbours; 0 is not measured. NaN if none is measured.

    The median second difference along rows is insensitive to surfaces and to a few borders; that of white noise is 1.65
    sigma.
    """
    left, middle, right = depth[:, :-2], depth[:, 1:-1], depth[:, 2:]
    whole = (left > 0) & (middle > 0) & (right > 0)
    return float(np.median(np.abs(left - 2.0 * middle + right)[whole])) / 1.652 if whole.any() else float("nan")


def mostly_noise(depth: np.ndarray) -> tuple[float, float] | None:
    """`pixel_noise` and median of a depth image (H, W) [m] with noise above `NOISY` times `depth_sigma`."""
    noise, middle = pixel_noise(depth), float(np.median(depth[depth > 0]))
    return (noise, middle) if noise > NOISY * float(depth_sigma(np.array(middle))) else None


def fit(points: np.ndarray, weights: np.ndarray | None = None) -> Plane:
    """Weighted total least squares plane of (N, 3) points; the sign of the normal is arbitrary."""
    w = np.ones(len(points)) if weights is None else weights
    middle = (points * w[:, None]).sum(axis=0) / w.sum()
    centred = points - middle
    values, vectors = np.linalg.eigh((centred * w[:, None]).T @ centred)
    normal = vectors[:, int(np.argmin(values))]
    return normal, -float(normal @ middle)


def distance(plane: Plane, points: np.ndarray) -> np.ndarray:
    """Signed distance of (..., 3) points along the normal."""
    return np.asarray(points @ plane[0] + plane[1])


def facing(plane: Plane) -> Plane:
    """The same plane with the normal towards the camera, which is the origin."""
    return plane if plane[1] >= 0 else (-plane[0], -plane[1])


def ransac(
    points: np.ndarray, sigma: np.ndarray, rng: np.random.Generator, *, trials: int = 300, gate: float = 3.0
) -> Plane:
    """The plane with the most points within `gate` standard deviations, weighted by proximity (MSAC), refined.

    Args:
        points: (N, 3), at least three.
        sigma: (N,) standard deviation of each point's distance [same unit].
        rng: Source of the samples.
        trials: Number of random triples.
        gate: Inlier threshold in standard deviations.
    """
    picks = rng.integers(0, len(points), size=(trials, 3))
    a, b, c = points[picks[:, 0]], points[picks[:, 1]], points[picks[:, 2]]
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    if not (lengths > 1e-9).any():
        return fit(points)  # all on a line: any plane through it
    normals = normals[lengths > 1e-9] / lengths[lengths > 1e-9, None]
    offsets = -(normals * a[lengths > 1e-9]).sum(axis=1)
    limit = gate * sigma
    squares = (np.square((points @ n + d) / limit) for n, d in zip(normals, offsets, strict=True))
    votes = [float(np.maximum(1.0 - square, 0.0).sum()) for square in squares]
    best = int(np.argmax(votes))
    return refine((normals[best], float(offsets[best])), points, sigma, gate=gate)


def largest(
    points: np.ndarray,
    sigma: np.ndarray,
    rng: np.random.Generator,
    *,
    gate: float = 3.0,
    least: int = 3,
    sampled: int = 4000,
) -> tuple[Plane, np.ndarray] | None:
    """The plane with the most points, by `ransac`, and which of them are on it; None without such a plane.

    Args:
        points: (N, 3) [m].
        sigma: (N,) standard deviation of each point's distance [m]: `depth_sigma` of its depth.
        rng: Source of the samples.
        gate: Inlier threshold in standard deviations.
        least: Minimum number of points on the plane, at least three.
        sampled: Maximum number of points, randomly chosen, that the plane is fitted to.

    Returns:
        The plane, and (N,) bool: whether a point is within `gate` standard deviations of it.
    """
    if len(points) < least:
        return None
    pick = rng.choice(len(points), size=min(sampled, len(points)), replace=False)
    plane = ransac(points[pick], sigma[pick], rng, gate=gate)
    near = np.abs(distance(plane, points)) < gate * sigma
    return (plane, near) if np.count_nonzero(near) >= least else None


def refine(plane: Plane, points: np.ndarray, sigma: np.ndarray, *, gate: float = 3.0, rounds: int = 8) -> Plane:
    """Iterated least squares on the inliers, weighted by 1 / sigma^2 and Tukey's biweight at `gate` sigmas."""
    for _ in range(rounds):
        u = distance(plane, points) / (gate * sigma)
        weights = np.where(np.abs(u) < 1.0, np.square(1.0 - np.square(u)), 0.0) / np.square(sigma)
        if np.count_nonzero(weights) < 3:
            return plane
        plane = fit(points, weights)
    return plane
