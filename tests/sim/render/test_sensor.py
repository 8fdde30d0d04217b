"""The camera's faults one by one, on pictures made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.robots.noise import DepthNoise
from dextera_build.geometry import cameras
from dextera_build.sim.render import sensor

K = np.array([[300.0, 0, 99.5], [0, 300.0, 74.5], [0, 0, 1]])
GREY = np.full((150, 200, 3), 0.5)


def plane(tilt: float) -> np.ndarray:
    """Depth (150, 200) of a plane through (0, 0, 1) m whose normal leans by `tilt` rad from the optical axis."""
    rows = (np.arange(150)[:, None] - K[1, 2]) / K[1, 1]
    return np.broadcast_to(np.cos(tilt) / (np.cos(tilt) + rows * np.sin(tilt)), (150, 200)).copy()


def test_edges_are_as_wide_as_told() -> None:
    depth = np.ones((20, 40))
    depth[:, 20:] = 2.0
    for width in (1, 2, 3):
        found = np.flatnonzero(sensor.edges(depth, width, 0.02)[10])
        assert found.tolist() == list(range(20 - width, 20 + width))


def test_small_steps_are_no_edges() -> None:
    depth = np.ones((20, 40))
    depth[:, 20:] = 1.015
    assert not sensor.edges(depth, 2, 0.02).any()


@pytest.mark.parametrize("tilt", [0.0, 0.6, 1.2])
def test_facing_is_the_cosine_between_ray_and_normal(tilt: float) -> None:
    cosine = sensor.facing(plane(tilt), K)[74:76, 99:101].mean()
    assert cosine == pytest.approx(np.cos(tilt), abs=0.01)


def test_nothing_comes_back_at_grazing_angles_or_out_of_range() -> None:
    rng = np.random.default_rng(0)
    clean = DepthNoise(dropout=0.0, edge_step=10.0)
    assert (sensor.measure_depth(plane(1.48), GREY, K, clean, rng)[70:80] == 0).mean() > 0.9
    assert (sensor.measure_depth(plane(1.0), GREY, K, clean, rng)[70:80] > 0).all()
    assert (sensor.measure_depth(plane(0.0) * 0.1, GREY, K, clean, rng) == 0).all()
    assert (sensor.measure_depth(plane(0.0) * 9.0, GREY, K, clean, rng) == 0).all()


def test_neighbouring_errors_are_correlated_over_the_window() -> None:
    wide = DepthNoise(dropout=0.0, step_m=1e-6, correlation_px=3)
    error = sensor.measure_depth(plane(0.0), GREY, K, wide, np.random.default_rng(1)).astype(np.float64) - 1.0
    neighbour = np.corrcoef(error[:, :-1].ravel(), error[:, 1:].ravel())[0, 1]
    far = np.corrcoef(error[:, :-3].ravel(), error[:, 3:].ravel())[0, 1]
    assert neighbour == pytest.approx(2 / 3, abs=0.05)
    assert abs(far) < 0.05


def test_dark_and_shiny_surfaces_lose_depth_in_patches() -> None:
    rgb = GREY.copy()
    rgb[:, :60], rgb[:, 140:] = 0.0, 1.0
    options = DepthNoise(dropout=0.0, dark_loss=0.6, shine_loss=0.8)
    lost = sensor.measure_depth(np.ones((150, 200)), rgb, K, options, np.random.default_rng(2)) == 0
    assert lost[:, :60].mean() == pytest.approx(0.6, abs=0.12)
    assert lost[:, 140:].mean() == pytest.approx(0.8, abs=0.12)
    assert not lost[:, 60:140].any()
    # Patches, not single pixels: a lost pixel's neighbour is mostly lost, too.
    assert (lost[:, 1:60] & lost[:, :59]).sum() / lost[:, 1:60].sum() > 0.8


def test_smeared_edges_lie_between_both_sides() -> None:
    depth = np.ones((150, 200))
    depth[:, 100:] = 1.5
    options = DepthNoise(dropout=0.0, subpixel_px=0.0, edge_loss=0.0, smear=1.0, grazing_deg=90.0)
    seen = sensor.measure_depth(depth, GREY, K, options, np.random.default_rng(3))
    band = seen[:, 98:102]
    assert ((band >= 1.0) & (band <= 1.5)).all()
    assert ((band > 1.05) & (band < 1.45)).mean() > 0.6
    assert (seen[:, :97] == 1.0).all()


def test_facing_is_that_of_the_cross_product_of_neighbours():
    random = np.random.default_rng(4)
    depth = plane(0.5) + random.normal(0.0, 0.002, (150, 200))
    depth[40:60, 50:90] = 0.6
    points = cameras.backproject(depth, K)
    normal = np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0))
    product = np.linalg.norm(normal, axis=-1) * np.linalg.norm(points, axis=-1)
    expected = np.abs((normal * points).sum(axis=-1)) / product
    assert sensor.facing(depth, K) == pytest.approx(expected, abs=1e-9)
    depth[40:60, 50:90] = 0.0
    assert (sensor.facing(depth, K)[40:60, 50:90] == 0).all()
