"""Each metric on a case whose value is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import metrics


def square(left: int, top: int, size: int, shape: tuple[int, int] = (60, 80)) -> np.ndarray:
    mask = np.zeros(shape, bool)
    mask[top : top + size, left : left + size] = True
    return mask


def sphere(
    radius: float, centre: tuple[float, float, float] = (0.0, 0.0, 0.0), rings: int = 60
) -> tuple[np.ndarray, np.ndarray]:
    """A sphere's triangles; poles are small triangles, seams are closed by index."""
    polar, around = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.arange(2 * rings) * np.pi / rings, indexing="ij")
    unit = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=-1)
    row, column = np.meshgrid(np.arange(rings), np.arange(2 * rings), indexing="ij")
    a = row * 2 * rings + column
    b = row * 2 * rings + (column + 1) % (2 * rings)
    c, d = a + 2 * rings, b + 2 * rings
    faces = np.concatenate([np.stack([a, c, d], -1).reshape(-1, 3), np.stack([a, d, b], -1).reshape(-1, 3)])
    return radius * unit.reshape(-1, 3) + centre, faces


def test_iou_of_a_shifted_square() -> None:
    one, other = square(10, 10, 20), square(15, 10, 20)
    assert metrics.mask_iou(one, other) == pytest.approx(15 / 25)
    assert metrics.mask_iou(one, one) == 1.0
    assert metrics.mask_iou(one, np.zeros_like(one)) == 0.0
    assert metrics.mask_iou(np.zeros_like(one), np.zeros_like(one)) == 0.0


def test_boundary_f1_counts_what_lies_within_the_tolerance() -> None:
    one, near, far = square(20, 20, 20), square(22, 20, 20), square(50, 20, 20)
    assert metrics.boundary_f1(one, one, 1.0) == 1.0
    assert metrics.boundary_f1(near, one, 2.0) == 1.0
    assert 0.4 < metrics.boundary_f1(near, one, 1.0) < 0.7  # upper and lower edges agree, left and right do not
    assert metrics.boundary_f1(far, one, 2.0) == 0.0
    assert metrics.boundary_f1(np.zeros_like(one), one, 2.0) == 0.0


def test_boundary_tolerance_below_one_is_a_part_of_the_diagonal_rounded_up() -> None:
    assert metrics.boundary_tolerance((720, 1280), 0.008) == 12.0
    assert metrics.boundary_tolerance((480, 640), 0.008) == 7.0
    assert metrics.boundary_tolerance((480, 640), 2.0) == 2.0


def test_rgb_mae_is_a_part_of_full_scale_and_looks_only_where_told() -> None:
    black = np.zeros((60, 80, 3), np.uint8)
    other = black.copy()
    other[..., 0] = 51
    other[0, 0] = 255
    where = square(20, 20, 10)
    assert metrics.rgb_mae(black, other, where) == pytest.approx(0.2 / 3)
    assert metrics.rgb_mae(black, other, np.zeros_like(where)) is None


@pytest.mark.parametrize(
    ("rgb", "wanted"),
    [
        ((255, 255, 255), (100.0, 0.0, 0.0)),
        ((255, 0, 0), (53.24, 80.09, 67.20)),
        ((0, 255, 0), (87.73, -86.18, 83.18)),
        ((0, 0, 255), (32.30, 79.19, -107.86)),
        ((128, 128, 128), (53.59, 0.0, 0.0)),
        ((3, 3, 3), (0.82, 0.0, 0.0)),
    ],
)
def test_lab_values_of_known_colours(rgb: tuple[int, int, int], wanted: tuple[float, float, float]) -> None:
    np.testing.assert_allclose(metrics.lab(np.array([rgb], np.uint8))[0], wanted, atol=0.02)


def test_delta_e_of_red_and_green_is_not_that_of_scaled_bytes() -> None:
    red, green = np.zeros((2, 2, 3), np.uint8), np.zeros((2, 2, 3), np.uint8)
    red[..., 0], green[..., 1] = 255, 255
    assert metrics.delta_e76(red, green, np.ones((2, 2), bool)) == pytest.approx(170.6, abs=0.1)
    assert metrics.delta_e76(red, red, np.ones((2, 2), bool)) == 0.0


def test_depth_mae_leaves_invalid_pixels_out() -> None:
    one = np.full((4, 4), 1.0, np.float32)
    other = one + 0.01
    other[0] = 0.0
    everywhere = np.ones((4, 4), bool)
    assert metrics.depth_mae(one, other, everywhere) == pytest.approx(0.01, abs=1e-6)
    assert metrics.depth_mae(one, np.zeros_like(one), everywhere) is None


def test_samples_lie_on_the_sphere_and_are_spread_by_area() -> None:
    points = metrics.sample_surface(*sphere(0.1), 20000, 0)
    radius = np.linalg.norm(points, axis=1)
    assert 0.0998 < radius.min() <= radius.max() <= 0.1 + 1e-12
    # Archimedes: equal heights have equal area.
    counts, _ = np.histogram(points[:, 2], bins=10, range=(-0.1, 0.1))
    assert np.abs(counts / 2000 - 1).max() < 0.08


def test_sampling_is_set_by_its_seed() -> None:
    surface = sphere(0.1)
    np.testing.assert_array_equal(metrics.sample_surface(*surface, 50, 3), metrics.sample_surface(*surface, 50, 3))
    assert (metrics.sample_surface(*surface, 50, 3) != metrics.sample_surface(*surface, 50, 4)).any()


def test_centroid_does_not_depend_on_tessellation() -> None:
    vertices, faces = sphere(0.1, (0.3, -0.2, 0.5))
    np.testing.assert_allclose(metrics.surface_centroid(vertices, faces), [0.3, -0.2, 0.5], atol=1e-9)
    half_finer = np.concatenate([faces[:100], faces[100:]])[::-1]
    np.testing.assert_allclose(metrics.surface_centroid(vertices, half_finer), [0.3, -0.2, 0.5], atol=1e-9)


def test_chamfer_and_f_of_identical_surfaces() -> None:
    points = metrics.sample_surface(*sphere(0.1), 5000, 0)
    assert metrics.chamfer_and_f(points, points, 0.01) == (0.0, 1.0)


def test_chamfer_and_f_of_a_grown_sphere() -> None:
    one = metrics.sample_surface(*sphere(0.10), 20000, 0)
    grown = metrics.sample_surface(*sphere(0.12), 20000, 1)
    chamfer, score = metrics.chamfer_and_f(one, grown, 0.01)
    assert chamfer == pytest.approx(0.02, rel=0.02)
    assert score == 0.0
    assert metrics.chamfer_and_f(one, grown, 0.03)[1] == 1.0


def test_chamfer_of_a_translated_sphere_is_half_the_shift_for_small_shifts() -> None:
    # The nearest point of a sphere shifted by d lies d |cos| away to first order, and |cos| is 1/2 on average.
    one = metrics.sample_surface(*sphere(0.10), 60000, 0)
    moved = metrics.sample_surface(*sphere(0.10, (0.01, 0.0, 0.0)), 60000, 1)
    chamfer, score = metrics.chamfer_and_f(one, moved, 0.011)
    assert chamfer == pytest.approx(0.005, rel=0.05)
    assert score == 1.0


def test_matching_is_one_to_one_and_maximises_the_total() -> None:
    overlaps = np.array([[0.6, 0.5], [0.55, 0.0], [0.05, 0.0]])
    assert metrics.match(overlaps, 0.1) == [(0, 1), (1, 0)]
    assert metrics.match(np.zeros((2, 0)), 0.1) == []


def test_mean_and_deviation_count_what_is_known() -> None:
    mean, deviation, count = metrics.mean_std([1.0, None, 3.0])
    assert (mean, count) == (2.0, 2)
    assert deviation == pytest.approx(np.sqrt(2))
    assert metrics.mean_std([None]) == (None, None, 0)
    assert metrics.mean_std([2.0]) == (2.0, None, 1)


def test_psnr_is_that_of_the_mean_square_where_it_is_asked() -> None:
    one = np.zeros((4, 5, 3), np.uint8)
    other = one.copy()
    other[0] = 51
    top = np.zeros((4, 5), bool)
    top[0] = True
    assert metrics.psnr(one, other, top) == pytest.approx(20 * np.log10(5))
    assert metrics.psnr(one, other, np.ones_like(top)) == pytest.approx(20 * np.log10(10))
    assert metrics.psnr(one, other, ~top) is None
    assert metrics.psnr(one, other, np.zeros_like(top)) is None


def test_ssim_is_one_for_equal_pictures_and_falls_with_noise_and_blur() -> None:
    rng = np.random.default_rng(0)
    one = rng.integers(0, 255, (40, 50, 3)).astype(np.uint8)
    everywhere = np.ones((40, 50), bool)
    assert metrics.ssim(one, one, everywhere) == pytest.approx(1.0)
    little, much = (np.clip(one + rng.normal(0, s, one.shape), 0, 255).astype(np.uint8) for s in (10, 60))
    assert 1.0 > metrics.ssim(one, little, everywhere) > metrics.ssim(one, much, everywhere) > 0.2
    assert metrics.ssim(one, np.full_like(one, 128), everywhere) < 0.1
    assert metrics.ssim(one, one, np.zeros((40, 50), bool)) is None


def test_ssim_is_the_published_formula_for_flat_pictures() -> None:
    one, other = np.full((30, 30, 3), 100, np.uint8), np.full((30, 30, 3), 120, np.uint8)
    luminance = (2 * 100 * 120 + (0.01 * 255) ** 2) / (100**2 + 120**2 + (0.01 * 255) ** 2)
    assert metrics.ssim(one, other, np.ones((30, 30), bool)) == pytest.approx(luminance)


def test_depth_errors_are_those_of_the_pixels_where_both_are_valid() -> None:
    truth = np.array([[1.0, 2.0, 4.0, 0.0, 2.0]])
    found = np.array([[1.1, 2.0, 6.0, 3.0, 0.0]])
    errors = metrics.depth_errors(found, truth, np.ones_like(truth, bool))
    assert errors is not None
    assert errors.mae == pytest.approx(0.7)
    assert errors.rmse == pytest.approx(np.sqrt((0.01 + 4) / 3))
    assert errors.median == pytest.approx(0.1)
    assert errors.abs_rel == pytest.approx((0.1 + 0.5) / 3)
    assert errors.delta1 == pytest.approx(2 / 3)
    assert metrics.depth_errors(found, truth, np.zeros_like(truth, bool)) is None
