"""Connected regions and outlines, against scipy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dextera_build.geometry import regions

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])


def test_labels_count_in_scan_order():
    mask = np.array([[0, 1, 0, 1], [1, 0, 0, 1], [1, 0, 1, 1]], bool)
    labels, count = regions.label(mask)
    assert (count, labels.dtype) == (3, np.int32)
    assert labels.tolist() == [[0, 1, 0, 2], [3, 0, 0, 2], [3, 0, 2, 2]]


def test_an_empty_mask_has_no_region():
    labels, count = regions.label(np.zeros((4, 5), bool))
    assert count == 0
    assert not labels.any()
    assert not regions.largest(np.zeros((4, 5), bool)).any()


def test_the_largest_region_counts_pixels_or_weight():
    mask = np.array([[1, 1, 1, 0, 1], [0, 0, 0, 0, 1]], bool)
    assert regions.largest(mask).sum() == 3
    weight = np.array([[1, 1, 1, 0, 5], [0, 0, 0, 0, 5]])
    assert regions.largest(mask, weight).sum() == 2


def test_a_hull_runs_counter_clockwise_and_drops_inner_points():
    rng = np.random.default_rng(0)
    inner = rng.uniform(0.1, 0.9, (40, 2)) * [2, 1]
    hull = regions.convex_hull(np.concatenate([inner, SQUARE]))
    assert {tuple(p) for p in hull} == {tuple(p) for p in SQUARE}
    assert regions.area(hull) == pytest.approx(2.0)
    assert regions.centroid(hull) == pytest.approx([1.0, 0.5])


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6))
def test_a_hull_of_many_points_agrees_with_scipy(seed):
    from scipy.spatial import ConvexHull

    points = np.random.default_rng(seed).normal(size=(500, 2)).round(2)
    hull = regions.convex_hull(points)
    wanted = ConvexHull(points)
    assert regions.area(hull) == pytest.approx(wanted.volume, rel=1e-9)
    assert {tuple(p) for p in hull} <= {tuple(p) for p in points}


def test_inside_knows_the_margin():
    points = np.array([[1.0, 0.5], [2.05, 0.5], [-1.0, 0.5]])
    assert regions.inside_convex(points, SQUARE).tolist() == [True, False, False]
    assert regions.inside_convex(points, SQUARE, margin=0.1).tolist() == [True, True, False]


def test_inside_is_what_every_edge_has_on_its_left():
    rng = np.random.default_rng(4)
    points = rng.uniform(-2.0, 2.0, (40, 50, 2))
    points[3, 4] = np.nan
    polygon = regions.convex_hull(rng.normal(0.0, 0.4, (300, 2)))
    edges = np.roll(polygon, -1, axis=0) - polygon
    apart = points[:, :, None] - polygon
    naive = (edges[:, 0] * apart[..., 1] - edges[:, 1] * apart[..., 0] >= 0).all(axis=-1)
    assert 100 < naive.sum() < 1900
    np.testing.assert_array_equal(regions.inside_convex(points, polygon), naive)
