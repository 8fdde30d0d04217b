"""Twists: they compose with poses as `geometry.uncertainty` says, and lead from one pose to another."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dextera_build.geometry import registration, transforms
from dextera_build.tracking import motions

SEEDS = st.integers(0, 10_000)


def pose(random: np.random.Generator) -> np.ndarray:
    turn = Rotation.random(random_state=int(random.integers(2**31))).as_matrix()
    return transforms.rigid(turn, random.normal(size=3))


@given(SEEDS)
def test_a_rotation_vector_is_that_of_scipy(seed):
    vector = np.random.default_rng(seed).normal(size=3)
    assert registration.rotation(vector) == pytest.approx(Rotation.from_rotvec(vector).as_matrix())
    assert registration.rotation_vector(registration.rotation(vector * 0.5)) == pytest.approx(vector * 0.5)


@given(SEEDS)
def test_the_twist_between_two_poses_leads_from_one_to_the_other(seed):
    random = np.random.default_rng(seed)
    first, second = pose(random), pose(random)
    assert motions.moved(first, motions.between(first, second)) == pytest.approx(second, abs=1e-7)


def test_a_twist_moves_a_point_by_translation_and_rotation_about_the_origin_of_the_object():
    """The convention of `geometry.uncertainty`: the rotation is not about the origin of the parent frame."""
    start = transforms.rigid(np.eye(3), np.array([0.0, 0.0, 5.0]))
    turned = motions.moved(start, np.array([0, 0, 0, 0, 0, 0.1]))
    assert turned[:3, 3] == pytest.approx([0.0, 0.0, 5.0])


def test_products_that_are_rounded_off_become_rotations_again():
    off = transforms.rigid(registration.rotation(np.array([0.1, 0.2, 0.3])) * 1.001, np.ones(3))
    made = motions.proper(off)
    assert made[:3, :3] @ made[:3, :3].T == pytest.approx(np.eye(3))


def test_the_way_of_points_includes_the_rotation():
    """A turn of a long thing about its middle is a motion, though its origin stays."""
    corners = np.array([(1.0, 0, 0), (-1.0, 0, 0)])
    turned = transforms.rigid(registration.rotation(np.array([0, 0, 0.01])), np.zeros(3))
    assert motions.displacement(np.eye(4), turned, corners) == pytest.approx(0.01, rel=1e-3)
