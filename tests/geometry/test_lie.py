"""Twists: their one order, their retraction, and the bases of motions that keep something."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dextera_build.geometry import lie, transforms

SEEDS = st.integers(0, 10_000)
POINTS = np.random.default_rng(0).normal(size=(20, 3))


def pose(random: np.random.Generator) -> np.ndarray:
    turn = Rotation.random(random_state=int(random.integers(2**31))).as_matrix()
    return transforms.rigid(turn, random.normal(size=3))


@given(SEEDS)
def test_a_rotation_vector_is_that_of_scipy(seed):
    vector = np.random.default_rng(seed).normal(size=3)
    assert lie.rotation(vector) == pytest.approx(Rotation.from_rotvec(vector).as_matrix())
    assert lie.rotation_vector(lie.rotation(vector * 0.5)) == pytest.approx(vector * 0.5)
    assert lie.about_z(vector[2]) == pytest.approx(lie.rotation(np.array([0.0, 0.0, vector[2]])), abs=1e-15)


@given(SEEDS)
def test_the_twist_between_two_poses_leads_from_one_to_the_other(seed):
    random = np.random.default_rng(seed)
    first, second = pose(random), pose(random)
    assert lie.retract(first, lie.between(first, second)) == pytest.approx(second, abs=1e-7)


def test_a_twist_moves_a_point_by_translation_and_rotation_about_the_origin_of_the_object():
    """The convention of `geometry.uncertainty`: the rotation is not about the origin of the parent frame."""
    start = transforms.rigid(np.eye(3), np.array([0.0, 0.0, 5.0]))
    turned = lie.retract(start, np.array([0, 0, 0, 0, 0, 0.1]))
    assert turned[:3, 3] == pytest.approx([0.0, 0.0, 5.0])
    assert turned[1, 0] == pytest.approx(np.sin(0.1)), "the sixth component is a rotation about z"
    assert lie.retract(start, np.array([0.1, 0, 0, 0, 0, 0]))[:3, 3] == pytest.approx([0.1, 0.0, 5.0])


@pytest.mark.parametrize("component", range(7))
def test_the_rows_of_points_are_the_derivatives_of_the_retraction(component):
    """One order in bases, rows and retraction: a swap in any of them fails."""
    pivot, normals = np.array([0.3, -0.2, 0.1]), np.roll(POINTS, 1, axis=0)
    twist = 1e-6 * lie.FREE[component]

    def at(twist: np.ndarray) -> np.ndarray:
        scale, placed = lie.retract_similarity(1.3, start, twist, pivot)
        return transforms.apply(placed, scale * POINTS)

    start = pose(np.random.default_rng(1))
    slope = (at(twist) - at(-twist)) / 2e-6
    arms = at(np.zeros(7)) - pivot
    assert lie.point_motions(arms)[:, :, component] == pytest.approx(slope, abs=1e-7)
    along = (normals * slope).sum(axis=1)
    assert lie.point_to_plane_rows(arms, normals)[:, component] == pytest.approx(along, abs=1e-7)


@pytest.mark.parametrize("component", range(6))
def test_a_motion_about_a_point_and_the_adjoint_say_the_same(component):
    pivot, start = np.array([0.3, -0.2, 0.1]), pose(np.random.default_rng(2))
    twist = 1e-6 * lie.RIGID[component]
    moved = lie.motion(twist, pivot) @ start
    assert lie.between(start, moved) == pytest.approx(lie.adjoint(start[:3, 3] - pivot) @ twist, abs=1e-11)


def test_a_scale_about_a_point_moves_the_origin_away_from_it():
    pivot, start = np.array([0.3, -0.2, 0.1]), pose(np.random.default_rng(2))
    scale, moved = lie.retract_similarity(2.0, start, 1e-6 * lie.FREE[6], pivot)
    assert scale == pytest.approx(2.0 + 2e-6)
    shift = lie.adjoint(start[:3, 3] - pivot, 7) @ (1e-6 * lie.FREE[6])
    assert moved[:3, 3] - start[:3, 3] == pytest.approx(shift[:3], abs=1e-11)


def test_a_rotation_about_a_line_keeps_the_line():
    axis, origin = np.array([0.6, 0.0, 0.8]), np.array([0.1, 0.2, 0.3])
    motion = lie.turned(axis, origin, 0.7)
    assert transforms.apply(motion, origin + 2.0 * axis) == pytest.approx(origin + 2.0 * axis)
    assert lie.rotation_vector(motion[:3, :3]) == pytest.approx(0.7 * axis)
    assert lie.about(axis, 0.7) == pytest.approx(motion[:3, :3], abs=1e-15)


def test_bases_keep_what_they_promise():
    start = transforms.rigid(lie.about_z(0.4), np.array([0.2, -0.1, 0.07]))
    step = np.array([0.02, -0.03, 0.01, 0.2, 0.1])
    scale, upright = lie.retract_similarity(1.0, start, lie.UPRIGHT @ step, np.zeros(3))
    assert upright[:3, 2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-15)
    assert scale == pytest.approx(np.exp(0.1))
    assert upright[:2, 3] != pytest.approx(start[:2, 3], abs=1e-3)
    small = 1e-6 * np.array([1.0, 2.0, 3.0, 4.0])
    on_plane = lie.retract_similarity(1.0, start, lie.resting(0.0) @ small, start[:3, 3] * [1, 1, 0])
    of_itself = lie.retract_similarity(1.0, start, lie.resting(0.07) @ small, start[:3, 3])
    for scale, moved in (on_plane, of_itself):
        assert moved[2, 3] == pytest.approx(scale * 0.07, abs=1e-11), "the contact is at z = 0"
        assert moved[:3, 2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-15)
    level = lie.motion(lie.PLANAR @ np.array([0.01, 0.02, 0.3]), np.array([1.0, 2.0, 3.0]))
    assert transforms.apply(level, POINTS)[:, 2] == pytest.approx(POINTS[:, 2])
    assert lie.rotation_vector(level[:3, :3]) == pytest.approx([0.0, 0.0, 0.3])
