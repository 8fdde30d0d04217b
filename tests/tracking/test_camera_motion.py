"""The motion of the camera from pairs of points, some of which are wrong."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build.geometry import lie, transforms
from dextera_build.tracking import camera_motion
from dextera_build.tracking.frame import Frame

K = np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]])


@given(st.integers(0, 1000))
def test_most_pairs_decide(seed: int):
    random = np.random.default_rng(seed)
    pose = transforms.rigid(lie.rotation(random.normal(size=3) * 0.2), random.normal(size=3) * 0.1)
    source = random.uniform([-0.5, -0.4, 0.6], [0.5, 0.4, 1.5], (80, 3))
    target = transforms.apply(pose, source) + random.normal(0, 0.001, (80, 3))
    target[:25] += random.normal(0, 0.3, (25, 3))  # things that move by themselves
    found = camera_motion.consensus(source, target)
    assert found is not None
    assert np.linalg.norm(lie.between(found, pose)) < 0.01
    assert np.linalg.det(found[:3, :3]) == pytest.approx(1.0)


def test_points_that_agree_with_no_motion_give_none():
    random = np.random.default_rng(0)
    source = random.uniform([-0.5, -0.4, 0.6], [0.5, 0.4, 1.5], (60, 3))
    assert camera_motion.consensus(source, random.permutation(source)) is None


def scene(shift: int) -> Frame:
    """A textured wall 1 m away, of which the camera sees another part."""
    random = np.random.default_rng(1)
    wall = np.kron(random.integers(0, 255, (40, 60, 3), dtype=np.uint8), np.ones((12, 12, 1), np.uint8))
    return Frame(
        np.ascontiguousarray(wall[100:340, 100 + shift : 420 + shift]), np.ones((240, 320), np.float32), K, 0.0
    )


def test_a_camera_that_stands_is_told_exactly():
    first, second = scene(0), scene(0)
    ways = camera_motion.flow(first, second, np.zeros((0, 2)))
    assert np.array_equal(camera_motion.motion(first, second, ways, np.zeros((240, 320), bool)), np.eye(4))


def test_a_camera_that_moves_is_measured_by_what_does_not():
    """12 px at 1 m with f = 300 px are 4 cm; pixels of objects do not count."""
    first, second = scene(0), scene(12)
    ways = camera_motion.flow(first, second, np.zeros((0, 2)))
    found = camera_motion.motion(first, second, ways, np.zeros((240, 320), bool))
    assert found is not None
    assert found[:3, 3] == pytest.approx([-0.04, 0.0, 0.0], abs=0.004)
    assert camera_motion.motion(first, second, ways, np.ones((240, 320), bool)) is None
