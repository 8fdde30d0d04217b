"""Real spherical harmonics up to degree 3 in the order and with the signs of 3D Gaussian splatting (Kerbl et al. 2023).

The basis is orthonormal on the sphere: Y_lm with the Condon-Shortley phase, m = -l..l within a band; the first band is
-y, z, -x.
"""

from __future__ import annotations

from functools import cache

import numpy as np

COUNTS = (1, 4, 9, 16)
"""Number of coefficients of degree 0, 1, 2, 3."""
_PROBES = 64


def basis(directions: np.ndarray, count: int) -> np.ndarray:
    """Values (N, count) of the functions in unit directions (N, 3); `count` is one of `COUNTS`."""
    x, y, z = np.moveaxis(directions, -1, 0)
    xx, yy, zz = x * x, y * y, z * z
    pi = np.pi
    values = [np.full_like(x, np.sqrt(1 / (4 * pi)))]
    first = np.sqrt(3 / (4 * pi))
    values += [-first * y, first * z, -first * x]
    if count > 4:
        second = np.sqrt(15 / (4 * pi))
        middle = np.sqrt(5 / (16 * pi)) * (2 * zz - xx - yy)
        values += [second * x * y, -second * y * z, middle, -second * x * z, second / 2 * (xx - yy)]
    if count > 9:
        a, b, c, d = np.sqrt(np.array([35 / 32, 105 / 4, 21 / 32, 7 / 16]) / pi)
        values += [-a * y * (3 * xx - yy), b * x * y * z, -c * y * (4 * zz - xx - yy)]
        values += [d * z * (2 * zz - 3 * xx - 3 * yy), -c * x * (4 * zz - xx - yy)]
        values += [b / 2 * z * (xx - yy), -a * x * (xx - 3 * yy)]
    return np.stack(values[:count], axis=-1)


def flat(colours: np.ndarray) -> np.ndarray:
    """Coefficients (N, 1, 3) of colours (N, 3), sRGB 0..1, that are the same from all sides."""
    return np.asarray((colours - 0.5) / basis(np.array([[0.0, 0.0, 1.0]]), 1)[0, 0])[:, None]


def rotation(turn: np.ndarray, count: int) -> np.ndarray:
    """Matrix (count, count) that transforms coefficients under a rotation (3, 3) of space: f'(R d) = f(d).

    It is computed from values in probe directions, so it follows the order and the signs of `basis` by construction.
    Bands do not mix; within a band the matrix is the real Wigner D matrix.
    """
    turned = np.zeros((count, count))
    probes = _probes()
    for degree in range(int(np.sqrt(count))):
        band = slice(degree**2, (degree + 1) ** 2)
        values = basis(probes @ turn, count)[:, band]  # rows are R^T p
        turned[band, band] = _inverse(degree) @ values
    return turned


@cache
def _probes() -> np.ndarray:
    """Unit directions (64, 3), evenly spread on a Fibonacci spiral."""
    step = np.arange(_PROBES) + 0.5
    height, turn = 1 - 2 * step / _PROBES, np.pi * (1 + np.sqrt(5)) * step
    ring = np.sqrt(1 - height**2)
    return np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=1)


@cache
def _inverse(degree: int) -> np.ndarray:
    values = basis(_probes(), COUNTS[degree])[:, degree**2 :]
    return np.asarray(np.linalg.pinv(values))
