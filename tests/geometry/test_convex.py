"""Convex surfaces: closed, outward, and never flat."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import convex


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    corners = vertices.astype(np.float64)[faces]
    return float(np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6)


@given(st.integers(0, 10_000), st.integers(4, 60))
@settings(max_examples=30, deadline=None)
def test_hulls_are_closed_and_face_outwards(seed: int, count: int) -> None:
    points = np.random.default_rng(seed).normal(size=(count, 3)).astype(np.float32)
    vertices, faces = convex.surface(points)
    assert Mesh(vertices=vertices, faces=faces).is_closed
    assert volume(vertices, faces) > 0


def test_a_cube_keeps_its_volume_whatever_the_order_of_its_points() -> None:
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
    first = convex.surface(corners)
    second = convex.surface(np.concatenate([corners[::-1], corners[:3], [[0.5, 0.5, 0.5]]]))
    assert volume(*first) == pytest.approx(1.0)
    assert all(a.tobytes() == b.tobytes() for a, b in zip(first, second, strict=True))


@pytest.mark.parametrize(
    "points", [np.zeros((1, 3)), np.eye(3)[:2], np.eye(3), np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])]
)
def test_degenerate_pieces_get_a_thickness(points: np.ndarray) -> None:
    vertices, faces = convex.surface(points.astype(np.float32))
    assert volume(vertices, faces) > 0
    assert np.linalg.svd(vertices - vertices.mean(axis=0))[1][-1] > convex.THINNEST_M / 2


def test_many_points_take_little_memory():
    import tracemalloc

    points = np.random.default_rng(0).normal(size=(20000, 3))
    tracemalloc.start()
    convex.surface(points)
    assert tracemalloc.get_traced_memory()[1] < 50e6  # 20,000 squared numbers would take 3.2 GB
    tracemalloc.stop()


def cube(x: float) -> convex.Convex:
    """A unit cube whose middle is at x."""
    corners = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (-0.5, 0.5)])
    return convex.Convex(corners + np.array([x, 0.0, 0.0]))


@given(st.floats(0.05, 0.95))
@settings(max_examples=20, deadline=None)
def test_a_cut_along_the_least_overlap_leaves_pieces_that_touch(deep: float) -> None:
    one, other = cube(0.0), cube(1.0 - deep)
    found, normal, end = one.overlap(other)
    assert found == pytest.approx(deep)
    left = one.beyond(normal, end)
    assert left is not None
    assert left.volume == pytest.approx(1.0 - deep)
    assert left.overlap(other)[0] == pytest.approx(0.0, abs=1e-9)


def test_pieces_apart_do_not_overlap_and_nothing_is_left_beyond_a_plane_outside() -> None:
    assert cube(0.0).overlap(cube(2.0))[0] == 0.0
    assert cube(0.0).beyond(np.array([1.0, 0.0, 0.0]), 0.6) is None
