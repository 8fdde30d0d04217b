"""Lens models on the plane z = 1 and on the sphere: distortion, its inverse, and its invertible range.

Brown-Conrady is OpenCV's `plumb_bob` and `rational_polynomial`; Kannala-Brandt is OpenCV's fisheye model, which ROS
calls `equidistant` (Kannala and Brandt, A generic camera model, 2006, with the odd terms up to the ninth order).
Coefficients keep OpenCV's order.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Polynomial

_TABLE = 4096
"""Number of samples of a distortion curve, which initialise Newton's method."""
_NEWTON = 12
_LAST_STEP = 1e-13
"""Step size at which Newton's method ends, on the plane z = 1 or [rad]."""
_EXACT = 1e-9
"""Largest remaining error of an inverse, on the plane z = 1 or [rad]."""


def brown_conrady(points: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Distorted positions (N, 2) of `points` (N, 2) on the plane z = 1.

    Args:
        points: Undistorted positions.
        k: (8,) k1 k2 p1 p2 k3 k4 k5 k6.
    """
    x, y = points.T
    s = x * x + y * y
    radial = _radial(s, k)
    dx = 2 * k[2] * x * y + k[3] * (s + 2 * x * x)
    dy = k[2] * (s + 2 * y * y) + 2 * k[3] * x * y
    return np.stack([x * radial + dx, y * radial + dy], axis=1)


def brown_conrady_limit(k: np.ndarray) -> float:
    """Radius on the plane z = 1 up to which radial distortion is monotonic; inf: everywhere.

    Beyond it two directions project to one pixel, so the model does not describe a real lens.
    """
    above, below = Polynomial([1, k[0], k[1], k[4]]), Polynomial([1, k[5], k[6], k[7]])
    s = Polynomial([0, 1])
    slope = (above + 2 * s * above.deriv()) * below - 2 * s * above * below.deriv()
    found = [_first_root(slope), _first_root(below)]
    return float(np.sqrt(min(found)))


def brown_conrady_inverse(places: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Points (N, 2) whose distorted positions are `places` (N, 2); NaN if there is none within the limit."""
    limit = brown_conrady_limit(k)
    angles = np.linspace(0, min(np.arctan(limit), np.radians(89.9)), _TABLE)
    radii = np.tan(angles)
    distance = np.hypot(*places.T)
    with np.errstate(all="ignore"):
        curve = radii * _radial(radii**2, k)
        # Rounding may distort the far end of a curve without a limit.
        rising = 1 + int(np.cumprod(np.diff(curve) > 0).sum())
    start = np.interp(distance, curve[:rising], radii[:rising])
    points = places * (start / np.where(distance > 0, distance, 1.0))[:, None]
    with np.errstate(all="ignore"):  # positions without a solution diverge, and are set to NaN at the end
        for _ in range(_NEWTON):
            step = _solved(_jacobian(points, k), brown_conrady(points, k) - places)
            points = points - step
            if not (np.abs(step) > _LAST_STEP).any():
                break
        error = np.abs(brown_conrady(points, k) - places).max(axis=1)
        good = (error <= _EXACT * np.maximum(1.0, distance)) & (np.hypot(*points.T) <= limit * (1 + 1e-9))
    return np.where(good[:, None], points, np.nan)


def kannala_brandt(theta: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Distance from the principal point, in focal lengths, of directions `theta` [rad] off the axis; `k` is (4,)."""
    return np.asarray(_kannala_brandt(k)(theta))


def kannala_brandt_limit(k: np.ndarray) -> float:
    """Angle off the axis [rad] up to which the distance from the principal point grows; at most pi."""
    slope = Polynomial([1, 3 * k[0], 5 * k[1], 7 * k[2], 9 * k[3]])  # of theta^2
    return float(min(np.sqrt(_first_root(slope)), np.pi))


def kannala_brandt_inverse(distance: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Angle off the axis [rad] of positions at `distance` from the principal point; NaN beyond the limit."""
    limit, curve = kannala_brandt_limit(k), _kannala_brandt(k)
    slope = curve.deriv()
    samples = np.linspace(0, limit, _TABLE)
    theta = np.interp(distance, curve(samples), samples)
    with np.errstate(all="ignore"):
        for _ in range(_NEWTON):
            step = (curve(theta) - distance) / slope(theta)
            theta = theta - step
            if not (np.abs(step) > _LAST_STEP).any():
                break
        good = (np.abs(curve(theta) - distance) <= _EXACT) & (theta <= limit * (1 + 1e-9)) & (theta >= -_EXACT)
    return np.where(good, theta, np.nan)


def directions(across: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Unit vectors (N, 3) at the angle `theta` (N,) [rad] off the z axis, towards `across` (N, 2) of any length."""
    length = np.hypot(*across.T)
    side = across * (np.sin(theta) / np.where(length > 0, length, 1.0))[:, None]
    return np.column_stack([side, np.cos(theta)])


def angle_checker(rays: np.ndarray, step_deg: float = 10.0) -> np.ndarray:
    """Checkerboard of azimuth and elevation as seen by a lens with these rays.

    Args:
        rays: (H, W, 3) unit directions, x right, y down, z forward; NaN outside the image of the lens.
        step_deg: Side of a square [deg].

    Returns:
        (H, W) uint8: light and dark squares, darker with the angle off the axis; 0 outside the image of the lens.
    """
    seen = np.isfinite(rays).all(axis=-1)
    x, y, z = np.where(seen[..., None], rays, [0.0, 0.0, 1.0]).transpose(2, 0, 1)
    azimuth, elevation = np.degrees(np.arctan2(x, z)), np.degrees(np.arctan2(y, np.hypot(x, z)))
    light = (np.floor(azimuth / step_deg) + np.floor(elevation / step_deg)) % 2 == 0
    grey = np.where(light, 235, 150) * (0.65 + 0.35 * z)
    return np.where(seen, grey, 0).astype(np.uint8)


def _radial(s: np.ndarray, k: np.ndarray) -> np.ndarray:
    above = 1 + s * (k[0] + s * (k[1] + s * k[4]))
    return np.asarray(above / (1 + s * (k[5] + s * (k[6] + s * k[7]))))


def _kannala_brandt(k: np.ndarray) -> Polynomial:
    return Polynomial([0, 1, 0, k[0], 0, k[1], 0, k[2], 0, k[3]])


def _first_root(polynomial: Polynomial) -> float:
    """The smallest positive real root; inf without one."""
    # Denormal coefficients would overflow, and are irrelevant in front of a camera.
    roots = polynomial.trim(1e-12).roots()
    real = roots[np.abs(roots.imag) <= 1e-6 * np.maximum(1.0, np.abs(roots))].real
    return float(real[real > 0].min(initial=np.inf))


def _jacobian(points: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Derivatives (N, 2, 2) of `brown_conrady`."""
    x, y = points.T
    s = x * x + y * y
    above, below = 1 + s * (k[0] + s * (k[1] + s * k[4])), 1 + s * (k[5] + s * (k[6] + s * k[7]))
    da, db = k[0] + s * (2 * k[1] + s * 3 * k[4]), k[5] + s * (2 * k[6] + s * 3 * k[7])
    radial, slope = above / below, 2 * (da * below - above * db) / below**2
    both = slope * x * y + 2 * k[2] * x + 2 * k[3] * y
    xx = radial + slope * x * x + 2 * k[2] * y + 6 * k[3] * x
    yy = radial + slope * y * y + 6 * k[2] * y + 2 * k[3] * x
    return np.stack([np.stack([xx, both], -1), np.stack([both, yy], -1)], axis=-2)


def _solved(matrices: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Solutions (N, 2) of 2 x 2 systems; not finite where a matrix is singular."""
    (a, b), (c, d) = matrices.transpose(1, 2, 0)
    u, v = sides.T
    return np.asarray(np.stack([d * u - b * v, a * v - c * u], axis=1) / (a * d - b * c)[:, None])
