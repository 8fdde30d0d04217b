"""The pose of a robot whose arm wears covers, from its surface, and its combination with another estimate."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from dextera_build.geometry import balanced_icp, robot_surfaces, uncertainty
from dextera_build.geometry.robot_covariance import Doubts
from tests.geometry.hand_eyes import error_of
from tests.geometry.toy_robots import Faults, capture

COVER_M = 0.003


def test_covers_move_the_model_and_not_the_camera() -> None:
    scene = capture(1, faults=Faults(cover_m=COVER_M))
    plain = balanced_icp.correct(scene.poses)
    found = robot_surfaces.register(scene.poses, plain.motion, doubts=Doubts(surface_m=0.002))
    before, after = (np.linalg.norm(error_of(each.motion, scene.error)[:3]) for each in (plain, found))
    assert after < 0.5 * before
    assert found.offsets["arm"] == pytest.approx(COVER_M, abs=0.0008)
    assert abs(found.offsets["hand"]) < 0.0005


def test_the_spread_is_the_mean_squared_motion_of_arm_and_hand() -> None:
    scene = capture(2)
    found = robot_surfaces.register(scene.poses, np.eye(4), doubts=Doubts(surface_m=0.001))
    along = np.array([0.001, -0.002, 0.002, 0.0, 0.0, 0.0])
    assert along @ found.spread @ along == pytest.approx(9e-6)
    about = 1e-3 * np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    squares = [
        np.mean(
            np.concatenate(
                [((pose[name].model[:, [0, 2]] - found.motion[[0, 2], 3]) ** 2).sum(axis=1) for pose in scene.poses]
            )
        )
        for name in ("arm", "hand")
    ]
    assert about @ found.spread @ about == pytest.approx(1e-6 * np.mean(squares), rel=0.05)


@pytest.mark.medium
def test_the_stated_covariance_holds_with_covers_and_wrong_encoders() -> None:
    far, faults = [], Faults(cover_m=0.001, joint_rad=0.001, encoder_rad=0.0003)
    for seed in range(12):
        scene = capture(seed, 5, faults=faults, size=0.3, hand_points=120)
        doubts = Doubts(faults.joint_rad, faults.encoder_rad, 0.001)
        start = balanced_icp.correct(scene.poses, points=1000).motion
        found = robot_surfaces.register(scene.poses, start, points=1000, doubts=doubts)
        error = error_of(found.motion, scene.error)
        far.append(float(error @ np.linalg.solve(found.covariance, error)))
    assert np.mean(np.array(far) < chi2.ppf(0.95, 6)) >= 0.9


def drawn(random: np.random.Generator) -> np.ndarray:
    """A covariance (6, 6)."""
    root = random.normal(size=(6, 6)) * random.uniform(0.1, 2.0, 6)
    return np.asarray(root @ root.T + 1e-3 * np.eye(6))


def test_a_worse_estimate_has_no_weight_and_a_better_one_all() -> None:
    first = drawn(np.random.default_rng(0))
    for factor, weight in ((4.0, 0.0), (0.25, 1.0)):
        found, covariance = uncertainty.intersected(first, factor * first, np.eye(6))
        assert found == weight
        np.testing.assert_allclose(covariance, min(factor, 1.0) * first)


def test_the_intersection_covers_errors_that_are_fully_correlated() -> None:
    """Both errors are the same standard normal numbers through the roots of both covariances."""
    for seed in range(20):
        random = np.random.default_rng(seed)
        first, second = drawn(random), drawn(random)
        cost = drawn(random)
        weight, covariance = uncertainty.intersected(first, second, cost)
        assert np.trace(cost @ covariance) <= min(np.trace(cost @ first), np.trace(cost @ second)) * (1 + 1e-9)
        gain = weight * covariance @ np.linalg.inv(second)
        for sign in (1.0, -1.0, 0.0):
            roots = np.linalg.cholesky(first), np.linalg.cholesky(second)
            cross = sign * roots[0] @ roots[1].T
            keep = np.eye(6) - gain
            true = keep @ first @ keep.T + gain @ second @ gain.T + keep @ cross @ gain.T + gain @ cross.T @ keep.T
            assert np.linalg.eigvalsh(covariance - true).min() > -1e-9 * np.trace(covariance)
