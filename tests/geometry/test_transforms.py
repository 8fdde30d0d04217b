"""Rigid and similarity motions by their axioms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dextera_build.geometry import transforms


def motion(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return transforms.rigid(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3))


@pytest.mark.parametrize("seed", range(5))
def test_group_axioms(seed):
    a, b, c = motion(seed), motion(seed + 10), motion(seed + 20)
    points = np.random.default_rng(seed).normal(size=(7, 3))
    np.testing.assert_allclose(a @ transforms.invert(a), np.eye(4), atol=1e-12)
    np.testing.assert_allclose((a @ b) @ c, a @ (b @ c), atol=1e-12)
    np.testing.assert_allclose(
        transforms.apply(a, transforms.apply(b, points)), transforms.apply(a @ b, points), atol=1e-12
    )


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 3.0, np.pi - 1e-7, np.pi])
def test_the_angle_is_right_near_its_ends(angle):
    rotation = Rotation.from_rotvec(angle * np.array([0.6, 0.0, 0.8])).as_matrix()
    assert transforms.angle(rotation) == pytest.approx(angle, abs=1e-7)


@pytest.mark.parametrize("seed", range(5))
def test_umeyama_recovers_a_similarity(seed):
    truth = motion(seed)
    source = np.random.default_rng(seed).normal(size=(30, 3))
    target = 1.7 * source @ truth[:3, :3].T + truth[:3, 3]
    scale, found = transforms.umeyama(source, target)
    assert scale == pytest.approx(1.7)
    np.testing.assert_allclose(found, truth, atol=1e-9)


def test_umeyama_never_reflects_and_does_not_inflate_the_scale():
    source = np.random.default_rng(3).normal(size=(50, 3))
    mirrored = source * [1.0, 1.0, -1.0]
    scale, found = transforms.umeyama(source, mirrored)
    assert np.linalg.det(found[:3, :3]) == pytest.approx(1.0)
    assert scale < 0.7


@pytest.mark.parametrize("target", [[0, 0, 1.0], [0, 0, -1.0], [1.0, 2.0, 3.0]])
def test_the_smallest_rotation_turns_one_direction_into_another(target):
    rotation = transforms.rotation_between(np.array([0.0, 0.0, 2.0]), np.array(target))
    np.testing.assert_allclose(rotation @ [0, 0, 1.0], np.array(target) / np.linalg.norm(target), atol=1e-9)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
