"""Quaternions: inverse of each other, one sign, half turns."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dextera_build.geometry import quaternions


@given(st.integers(0, 100_000))
def test_matrix_and_back(seed: int) -> None:
    rotation = Rotation.random(rng=np.random.default_rng(seed))
    quaternion = quaternions.from_matrix(rotation.as_matrix())
    assert quaternion[0] >= 0
    np.testing.assert_allclose(quaternions.to_matrix(quaternion), rotation.as_matrix(), atol=1e-12)
    expected = rotation.as_quat(canonical=True, scalar_first=True)
    np.testing.assert_allclose(np.abs(quaternion @ expected), 1.0, atol=1e-12)


@given(st.integers(0, 100_000))
def test_many_matrices_are_those_of_each(seed: int) -> None:
    made = np.random.default_rng(seed).normal(size=(3, 2, 4))
    made[0, 0] = np.nan
    found = quaternions.to_matrices(made)
    each = np.array([[quaternions.to_matrix(quaternion) for quaternion in row] for row in made])
    np.testing.assert_allclose(found, each, atol=1e-12)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_half_turns_have_one_sign(axis: int) -> None:
    signs = -np.ones(3)
    signs[axis] = 1.0
    wanted = np.zeros(4)
    wanted[1 + axis] = 1.0
    np.testing.assert_allclose(quaternions.from_matrix(np.diag(signs)), wanted, atol=1e-12)


@given(st.integers(0, 100_000))
def test_products_are_those_of_the_rotations(seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, second = (Rotation.random(5, rng=rng) for _ in range(2))
    product = quaternions.multiply(first.as_quat(scalar_first=True), second.as_quat(scalar_first=True))
    expected = (first * second).as_matrix()
    np.testing.assert_allclose([quaternions.to_matrix(q) for q in product], expected, atol=1e-12)
    one = quaternions.multiply(first[0].as_quat(scalar_first=True), second.as_quat(scalar_first=True))
    np.testing.assert_allclose(quaternions.to_matrix(one[3]), (first[0] * second[3]).as_matrix(), atol=1e-12)


@given(st.integers(0, 100_000))
def test_many_matrices_at_once(seed: int) -> None:
    rotations = Rotation.random(20, rng=np.random.default_rng(seed))
    half_turns = np.array([np.eye(3), *(2 * np.diag(axis) - np.eye(3) for axis in np.eye(3))])
    matrices = np.concatenate([rotations.as_matrix(), half_turns])
    found = quaternions.from_matrices(matrices)
    np.testing.assert_allclose([quaternions.to_matrix(each) for each in found], matrices, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-12)
