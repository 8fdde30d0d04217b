"""Local planes of a depth image: exact on planes, sharp at creases, calm in noise."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import cameras, normals, planes

K = np.array([[300.0, 0, 40.0], [0, 310.0, 30.0], [0, 0, 1]])


def inverse_depth(normal: np.ndarray, offset: float) -> np.ndarray:
    """Inverse depth of the plane normal . p + offset = 0 over 61 x 81 px."""
    return np.asarray(-(cameras.rays(61, 81, K) @ normal) / offset)


@pytest.mark.parametrize("direction", [(0.0, 0.0, -1.0), (0.0, -0.8, -0.6), (0.7, -0.1, -0.7)])
def test_a_slanted_plane_is_met_exactly(direction):
    normal = np.array(direction) / np.linalg.norm(direction)
    inverse = inverse_depth(normal, 0.8)
    found = normals.fit(inverse, np.full(inverse.shape, 0.002))
    assert found.residual.max() < 1e-9
    assert np.abs(found.normals(K) - normal).max() < 1e-6


def test_missing_depth_has_no_normal():
    inverse = inverse_depth(np.array([0.0, 0.0, -1.0]), 0.8)
    inverse[10:20] = 0.0
    found = normals.fit(inverse, np.full(inverse.shape, 0.002)).normals(K)
    assert not found[12:18].any()
    assert np.allclose(np.linalg.norm(found[25:], axis=-1), 1.0)


def test_sharpening_keeps_both_sides_of_a_crease():
    left, right = np.array([0.6, 0.0, -0.8]), np.array([-0.6, 0.0, -0.8])
    # The convex crease runs through the ray of column 40.
    inverse = np.minimum(inverse_depth(left, 0.8 * 0.8), inverse_depth(right, 0.8 * 0.8))
    tolerance = planes.depth_sigma(1 / inverse) * inverse**2
    plain = normals.fit(inverse, tolerance)
    sharp = normals.sharpen(plain, inverse, tolerance * 0.2).normals(K)
    for column in (37, 43):
        assert min(np.degrees(np.arccos(np.clip(sharp[30, column] @ n, -1, 1))) for n in (left, right)) < 2.0
    assert np.abs(sharp[30, 37] - sharp[30, 43]).max() > 1.0


def test_noise_is_averaged():
    inverse = inverse_depth(np.array([0.0, -0.6, -0.8]), 0.8)
    tolerance = planes.depth_sigma(1 / inverse) * inverse**2
    noisy = inverse + tolerance * np.random.default_rng(0).standard_normal(inverse.shape)
    found = normals.fit(noisy, tolerance).normals(K)[8:-8, 8:-8]
    angle = np.degrees(np.arccos(np.clip(found @ np.array([0.0, -0.6, -0.8]), -1, 1)))
    assert np.median(angle) < 8.0
