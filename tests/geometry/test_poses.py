"""Poses and motions say the same."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from dextera_build.geometry import lie, poses, transforms

vectors = st.tuples(*[st.floats(-2.0, 2.0)] * 3).map(np.array)


@given(vectors, vectors)
def test_there_and_back(turn, place):
    motion = transforms.rigid(lie.rotation(turn), place)
    pose = poses.from_matrix(motion)
    assert pose[3] >= 0.0
    assert np.allclose(poses.to_matrix(pose), motion, atol=1e-9)
    assert np.allclose(poses.to_matrix(np.concatenate([pose[:3], -pose[3:]])), motion, atol=1e-9)


def test_single_precision_becomes_double():
    assert poses.to_matrix(np.array([1, 2, 3, 1, 0, 0, 0], np.float32)).dtype == np.float64
