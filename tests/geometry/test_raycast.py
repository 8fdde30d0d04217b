"""Rays and cameras: planar depth, pixel centres, textures."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import cameras, raycast

K = np.array([[100.0, 0.0, 15.5], [0.0, 90.0, 11.5], [0.0, 0.0, 1.0]])
SQUARE = np.array([[-1, -1, 2], [1, -1, 2], [1, 1, 2], [-1, 1, 2]], np.float64)
TWO = np.array([[0, 1, 2], [0, 2, 3]])


def test_projection_undoes_backprojection():
    depth = np.random.default_rng(0).uniform(0.5, 3.0, (24, 32))
    points = cameras.backproject(depth, K)
    pixels = cameras.project(points.reshape(-1, 3), K).reshape(24, 32, 2)
    rows, columns = np.indices(depth.shape)
    np.testing.assert_allclose(pixels, np.stack([columns, rows], axis=-1), atol=1e-9)


def test_depth_is_planar_and_not_along_the_ray():
    seen = raycast.render([raycast.Surface(SQUARE, TWO)], K, np.eye(4), 24, 32)
    assert (seen.index == 0).all()
    np.testing.assert_allclose(seen.depth, 2.0, atol=1e-6)


def test_the_nearer_surface_wins_and_empty_pixels_are_zero():
    small = SQUARE * [0.05, 0.05, 0.5]
    seen = raycast.render([raycast.Surface(SQUARE * 0.2, TWO), raycast.Surface(small, TWO)], K, np.eye(4), 24, 32)
    assert seen.index[11, 15] == 0  # at 0.4 m, before the one at 1 m
    corner = raycast.render([raycast.Surface(small, TWO)], K, np.eye(4), 24, 32)
    assert corner.index[0, 0] == -1
    assert corner.depth[0, 0] == 0.0
    assert raycast.render([], K, np.eye(4), 4, 5).index.max() == -1


def test_rays_are_occluded_where_they_hit():
    rng = np.random.default_rng(0)
    corners = rng.uniform(-0.3, 0.3, (40, 3)) + np.array([0.0, 0.0, 2.0])
    scene = raycast.RayScene((corners, rng.integers(0, 40, (60, 3))))
    rays = np.zeros((5000, 6), np.float32)
    rays[:, 3:] = np.column_stack([rng.normal(0.0, 0.1, (5000, 2)), np.ones(5000)])
    hit = np.isfinite(scene.cast(rays).distance)
    assert 0.1 < hit.mean() < 0.9
    np.testing.assert_array_equal(scene.occluded(rays, np.inf), hit)


def test_a_texture_stands_upright():
    texture = np.zeros((2, 2, 3), np.uint8)
    texture[0, 0] = (255, 0, 0)  # upper left of the picture
    # The camera's y runs down, so corner 0 is the upper left one, with v = 1.
    uv = np.array([[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0, 0]]], np.float64)
    surface = raycast.Surface(SQUARE * [0.2, 0.2, 1.0], TWO, uv, texture)
    seen = raycast.render([surface], K, np.eye(4), 24, 32)
    pixels = raycast.shade([surface], seen)
    inside = np.argwhere(seen.index == 0)
    (top, left), (bottom, right) = inside.min(axis=0), inside.max(axis=0)
    assert tuple(pixels[top + 1, left + 1]) == (255, 0, 0)
    assert tuple(pixels[bottom - 1, right - 1]) == (0, 0, 0)


def test_a_moved_camera_sees_a_moved_world():
    pose = np.eye(4)
    pose[:3, 3] = (0.3, -0.2, -1.0)
    moved = raycast.render([raycast.Surface(SQUARE + pose[:3, 3], TWO)], K, pose, 24, 32)
    assert moved.depth == pytest.approx(np.full((24, 32), 2.0), abs=1e-5)
