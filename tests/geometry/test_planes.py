"""Plane fits: exact data, outliers, clusters, determinism."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import planes

NORMAL = np.array([0.1, -0.8, -0.59]) / np.linalg.norm([0.1, -0.8, -0.59])


def on_plane(count: int, rng: np.random.Generator, noise: float = 0.0) -> np.ndarray:
    side = np.cross(NORMAL, [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    along = np.cross(NORMAL, side)
    spread = rng.uniform(-0.4, 0.4, (count, 2))
    points = spread @ np.stack([side, along]) - 0.7 * NORMAL
    return points + NORMAL * rng.normal(0, noise, (count, 1))


def test_a_fit_through_points_of_a_plane_is_that_plane():
    normal, offset = planes.facing(planes.fit(on_plane(50, np.random.default_rng(0))))
    assert normal == pytest.approx(NORMAL, abs=1e-9)
    assert offset == pytest.approx(0.7, abs=1e-9)


def test_weights_of_zero_leave_points_out():
    points = on_plane(50, np.random.default_rng(0))
    spoiled = np.concatenate([points, points + np.array([0, 0, 3.0])])
    weights = np.repeat([1.0, 0.0], 50)
    assert planes.facing(planes.fit(spoiled, weights))[1] == pytest.approx(0.7, abs=1e-9)


def test_facing_turns_the_normal_to_the_camera_and_keeps_the_plane():
    plane = (-NORMAL, -0.7)
    turned = planes.facing(plane)
    assert turned[0] @ (-0.7 * NORMAL) < 0
    points = on_plane(9, np.random.default_rng(1))
    assert np.abs(planes.distance(turned, points)).max() < 1e-12


def test_ransac_finds_the_plane_among_two_thirds_of_outliers():
    rng = np.random.default_rng(2)
    points = np.concatenate([on_plane(400, rng, 0.002), rng.uniform(-0.5, 0.5, (800, 3)) + np.array([0, 0, 0.8])])
    normal, offset = planes.facing(planes.ransac(points, np.full(1200, 0.002), np.random.default_rng(0)))
    assert np.degrees(np.arccos(min(1.0, normal @ NORMAL))) < 0.3
    assert offset == pytest.approx(0.7, abs=0.002)


def test_ransac_with_the_same_seed_gives_the_same_plane():
    points = on_plane(300, np.random.default_rng(3), 0.002)
    first, second = (planes.ransac(points, np.full(300, 0.002), np.random.default_rng(7)) for _ in range(2))
    assert np.array_equal(first[0], second[0])
    assert first[1] == second[1]


def test_refining_does_not_follow_a_distant_cluster():
    rng = np.random.default_rng(4)
    points = np.concatenate([on_plane(400, rng, 0.002), on_plane(300, rng) + 0.05 * NORMAL])
    normal, offset = planes.facing(planes.refine((NORMAL, 0.7), points, np.full(700, 0.002)))
    assert offset == pytest.approx(0.7, abs=0.001)
    assert abs(normal @ NORMAL) > 0.9999


def test_depth_noise_grows_with_the_square_of_the_distance():
    near, far = planes.depth_sigma(np.array([1.0, 2.0])) - planes.depth_sigma(np.array(0.0))
    assert far == pytest.approx(4 * near)
