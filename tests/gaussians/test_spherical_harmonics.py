"""Spherical harmonics: orthonormal, in the order of 3D Gaussian splatting, and turned without error."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import sph_harm_y

from dextera_build.gaussians import spherical_harmonics as harmonics

RNG = np.random.default_rng(1)


def directions(count: int) -> np.ndarray:
    made = RNG.normal(size=(count, 3))
    return made / np.linalg.norm(made, axis=1, keepdims=True)


def test_they_are_the_real_parts_of_the_complex_ones():
    """Real Y_lm from SciPy's complex ones, whose phase is that of Condon and Shortley."""
    d = directions(50)
    polar, azimuth = np.arccos(d[:, 2]), np.arctan2(d[:, 1], d[:, 0])
    columns = []
    for degree in range(4):
        for order in range(-degree, degree + 1):
            value = sph_harm_y(degree, abs(order), polar, azimuth)
            part = value.imag if order < 0 else value.real
            columns.append(part * (1 if order == 0 else np.sqrt(2)))
    assert np.abs(harmonics.basis(d, 16) - np.stack(columns, axis=1)).max() < 1e-13


def test_the_first_ones_have_the_constants_of_the_authors():
    x, y, z = 0.48, -0.6, 0.64
    first = harmonics.basis(np.array([[x, y, z]]), 9)[0]
    assert first[:4] == pytest.approx(
        [0.28209479177387814, *(0.4886025119029199 * np.array([-y, z, -x]))], rel=1e-15, abs=0
    )
    assert first[4] == pytest.approx(1.0925484305920792 * x * y, rel=1e-14)
    assert first[6] == pytest.approx(0.31539156525252005 * (2 * z * z - x * x - y * y), rel=1e-14)


@pytest.mark.parametrize("count", harmonics.COUNTS)
def test_turned_colours_are_seen_in_turned_directions(count):
    worst = 0.0
    for turn in Rotation.random(100, rng=RNG).as_matrix():
        coefficients, d = RNG.normal(size=count), directions(50)
        turned = harmonics.rotation(turn, count) @ coefficients
        error = harmonics.basis(d @ turn.T, count) @ turned - harmonics.basis(d, count) @ coefficients
        worst = max(worst, float(np.abs(error).max()))
    assert worst < 2e-14


def test_turns_follow_one_another():
    first, second = Rotation.random(2, rng=RNG).as_matrix()
    together = harmonics.rotation(second, 16) @ harmonics.rotation(first, 16)
    assert np.abs(harmonics.rotation(second @ first, 16) - together).max() < 2e-14
    assert np.abs(together @ together.T - np.eye(16)).max() < 2e-14
