"""Where cameras look, by what they see."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from dextera_build.errors import ArtifactError
from dextera_build.geometry import cameras

places = st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(np.array)


@given(places, places)
def test_a_camera_sees_its_target_in_the_middle_and_the_horizon_level(eye, target):
    assume(np.linalg.norm((target - eye)[:2]) > 1e-2)
    pose = cameras.look_at(eye, target)
    seen = np.linalg.inv(pose) @ [*target, 1.0]
    assert np.allclose(seen[:2], 0.0, atol=1e-9)
    assert seen[2] == pytest.approx(np.linalg.norm(target - eye))
    assert np.allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3))
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
    assert pose[2, 0] == pytest.approx(0.0, abs=1e-12)
    # Image down has no part that points up.
    assert pose[2, 1] < 1e-12


def test_a_point_along_the_ray_through_a_pixel_is_seen_at_it():
    k = np.array([[500.0, 0.0, 310.0], [0.0, 520.0, 250.0], [0.0, 0.0, 1.0]])
    pixels = np.random.default_rng(0).uniform(-50, 700, (4, 5, 2))
    rays = cameras.directions(pixels, k)
    assert np.allclose(cameras.project(2.5 * rays.reshape(-1, 3), k), pixels.reshape(-1, 2))
    assert np.allclose(cameras.rays(480, 640, k)[7, 11], cameras.directions(np.array([11.0, 7.0]), k))


def test_straight_down_is_refused():
    with pytest.raises(ArtifactError, match="straight up or down"):
        cameras.look_at(np.array([0.1, 0.2, 1.0]), np.array([0.1, 0.2, 0.0]))
