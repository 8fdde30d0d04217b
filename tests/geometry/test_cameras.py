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


def test_straight_down_is_refused():
    with pytest.raises(ArtifactError, match="straight up or down"):
        cameras.look_at(np.array([0.1, 0.2, 1.0]), np.array([0.1, 0.2, 0.0]))
