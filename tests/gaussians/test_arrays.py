"""Gaussians: covariances and similarities."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from dextera_build.gaussians import arrays
from dextera_build.geometry import transforms
from tests import factories

MOTION = transforms.rigid(Rotation.from_rotvec([0.4, 2.0, -0.7]).as_matrix(), np.array([1.0, -2.0, 0.5]))


def test_covariances_have_the_scales_along_the_axes():
    made = factories.gaussians(20)
    axes = Rotation.from_quat(made.rotations, scalar_first=True).as_matrix()
    assert np.allclose(arrays.turns(made.rotations), axes, atol=1e-14)
    along = axes.transpose(0, 2, 1) @ arrays.covariances(made) @ axes
    assert np.allclose(along, np.eye(3) * (made.scales**2)[:, None, :], atol=1e-15)


def test_a_similarity_moves_points_and_covariances():
    made = factories.gaussians(20)
    moved = arrays.moved(made, MOTION, 2.5)
    assert np.allclose(moved.means, transforms.apply(MOTION, 2.5 * made.means), atol=1e-14)
    turn = MOTION[:3, :3]
    wanted = 2.5**2 * turn @ arrays.covariances(made) @ turn.T
    assert np.allclose(arrays.covariances(moved), wanted, atol=1e-15)
    assert np.array_equal(moved.opacities, made.opacities)


def test_colours_are_those_of_the_same_side():
    made = factories.gaussians(20)
    eye = np.array([0.3, -2.0, 1.0])
    moved = arrays.moved(made, MOTION, 2.5)
    before, after = arrays.colours(made, eye), arrays.colours(moved, transforms.apply(MOTION, 2.5 * eye))
    assert np.abs(after - before).max() < 1e-14
    assert before.min() >= 0
    assert np.ptp(before) > 0.3
