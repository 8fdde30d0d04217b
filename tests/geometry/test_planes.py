"""Plane fits: exact data, outliers, clusters, determinism; the noise model against a simulated camera."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.robots.noise import DepthNoise
from dextera_build.geometry import planes
from dextera_build.sim.render import sensor

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


@pytest.mark.parametrize("z", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("share", [0.4, 0.8])
def test_the_largest_plane_is_found_at_any_distance_with_its_share_of_the_points(z, share):
    rng = np.random.default_rng(5)
    true = planes.facing((NORMAL, 0.8 * z))
    rays = np.column_stack([rng.uniform(-0.2, 0.2, (3000, 2)), np.ones(3000)])
    depth = -true[1] / (rays @ true[0])
    depth += rng.normal(0.0, planes.depth_sigma(depth))
    clutter = rng.uniform(size=3000) > share
    depth[clutter] = rng.uniform(0.6 * z, 2.0 * z, clutter.sum())
    points = rays * depth[:, None]
    (normal, offset), near = planes.largest(points, planes.depth_sigma(depth), np.random.default_rng(0))
    assert np.degrees(np.arccos(abs(float(normal @ true[0])))) < 0.5
    assert abs(offset) == pytest.approx(true[1], abs=0.5 * planes.depth_sigma(z))
    # Points in front of and behind the plane may be within the gate by chance; it is narrow against their spread.
    assert near[~clutter].mean() > 0.99
    assert near[clutter].mean() < 0.1


def test_the_largest_plane_is_fitted_to_a_sample_but_holds_all_its_points():
    points = on_plane(900, np.random.default_rng(6), 0.002)
    plane, near = planes.largest(points, np.full(900, 0.002), np.random.default_rng(0), sampled=100)
    assert len(near) == 900
    assert near.mean() > 0.98
    assert abs(plane[0] @ NORMAL) > 0.999


def test_without_enough_points_on_it_there_is_no_largest_plane():
    points = np.random.default_rng(7).uniform(-1.0, 1.0, (60, 3))
    sigma = np.full(60, 0.001)
    assert planes.largest(points, sigma, np.random.default_rng(0)) is not None
    assert planes.largest(points, sigma, np.random.default_rng(0), least=20) is None
    assert planes.largest(points[:2], sigma[:2], np.random.default_rng(0)) is None


def test_points_of_a_line_are_on_a_plane():
    points = np.outer(np.linspace(0.5, 1.5, 20), [0.1, 0.2, 1.0])
    _, near = planes.largest(points, np.full(20, 0.001), np.random.default_rng(0))
    assert near.all()


def test_depth_noise_is_a_millimetre_nearby_and_grows_with_the_square_of_the_distance():
    distances = np.array([0.0, 0.5, 1.0, 2.0, 4.0])
    assert planes.depth_sigma(distances) == pytest.approx(0.001 + 0.0015 * distances**2)


@pytest.mark.parametrize("z", [0.5, 1.0, 2.0])
def test_a_simulated_camera_has_at_most_the_noise_of_the_model_and_the_same_growth(z):
    true = np.full((120, 160), z)
    k = np.array([[600.0, 0.0, 79.5], [0.0, 600.0, 59.5], [0.0, 0.0, 1.0]])
    grey = np.full((120, 160, 3), 0.5)
    depth = sensor.measure_depth(true, grey, k, DepthNoise(step_m=1e-6), np.random.default_rng(8))
    spread = float(np.std(depth[depth > 0]))
    assert spread < planes.depth_sigma(z)
    assert spread == pytest.approx(planes.depth_sigma(z) - planes.depth_sigma(0.0), rel=0.15)
