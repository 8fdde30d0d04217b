"""Morphology-balanced ICP: the hand is right even where the arm's model is not, and the covariance is honest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from dextera_build.geometry import balanced_icp, robot_pairs, transforms
from dextera_build.geometry.robot_covariance import Doubts
from dextera_build.geometry.robot_pairs import Surface
from tests.geometry.hand_eyes import error_of
from tests.geometry.toy_robots import Faults, capture


def test_without_faults_the_correction_is_the_true_one() -> None:
    scene = capture(1)
    assert scene.hand_error(np.eye(4)) > 0.008
    found = balanced_icp.correct(scene.poses)
    assert scene.hand_error(found.motion) < 3e-4
    error = error_of(found.motion, scene.error)
    assert np.linalg.norm(error[:3]) < 1e-3
    assert np.degrees(np.linalg.norm(error[3:])) < 0.05


@pytest.mark.slow
def test_a_biased_arm_does_not_push_the_hand() -> None:
    """The golden test of an arm model that is 2 % off, with 20 points of the arm for each of the hand."""
    off: dict[bool, list[float]] = {True: [], False: []}
    for seed in range(8):
        scene = capture(seed, faults=Faults(shape_scale=1.02))
        for balanced, errors in off.items():
            found = balanced_icp.correct(scene.poses, balanced=balanced)
            errors.append(scene.hand_error(found.motion))
    assert np.median(off[True]) < 0.0025
    assert np.median(off[False]) > 2.5 * np.median(off[True])


def test_components_count_alike_after_trimming(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of the hand's measured points are gone: it still counts as much as the arm."""
    scene = capture(2)
    middle = np.median(np.concatenate([pose["hand"].seen for pose in scene.poses]), axis=0)
    poses = [
        {**pose, "hand": replace(pose["hand"], seen=pose["hand"].seen[pose["hand"].seen[:, 1] > middle[1] - 0.15])}
        for pose in scene.poses
    ]
    matched = robot_pairs.matched(poses, 2000, True, np.random.default_rng(0))
    pairs = matched.pairs
    target = np.where(pairs.part[:, None] == 1, pairs.model + 0.01, pairs.model), pairs.normals
    monkeypatch.setattr(robot_pairs.Matched, "near", lambda *_: target)
    _, _, weight = balanced_icp.linear(np.eye(4), matched, np.zeros(3), True)
    assert weight[pairs.part == 0].sum() == pytest.approx(0.5)
    assert weight[pairs.part == 1].sum() == pytest.approx(0.5)


def test_no_point_of_the_arm_is_matched_with_the_hand() -> None:
    """An arm that is seen where the hand is attracts no point of the hand."""
    scene = capture(3, size=0.0)
    swapped = [
        {**pose, "arm": replace(pose["arm"], seen=np.concatenate([pose["arm"].seen, pose["hand"].model + 0.004]))}
        for pose in scene.poses
    ]
    found = balanced_icp.correct(swapped)
    assert scene.hand_error(found.motion) < 5e-4


def test_the_correction_is_a_left_product_in_the_camera_frame() -> None:
    scene = capture(4)
    found = balanced_icp.correct(scene.poses)
    moved = [
        {
            name: replace(
                each, model=transforms.apply(found.motion, each.model), normals=each.normals @ found.motion[:3, :3].T
            )
            for name, each in pose.items()
        }
        for pose in scene.poses
    ]
    again = balanced_icp.correct(moved).motion
    np.testing.assert_allclose(again, np.eye(4), atol=4e-4)


def test_few_points_are_refused() -> None:
    nothing = np.zeros((3, 3))
    with pytest.raises(ValueError, match="too few points"):
        balanced_icp.correct([{"arm": Surface(nothing, nothing, np.zeros(3, int), nothing)}])


@pytest.mark.slow
@pytest.mark.parametrize("faults", [Faults(joint_rad=0.002, encoder_rad=0.002), Faults(encoder_rad=0.003)])
def test_the_stated_covariance_is_honest(faults: Faults) -> None:
    """The benchmark has 300 draws; here the bounds are those of 24."""
    far = []
    for seed in range(24):
        scene = capture(seed, 5, faults=faults, size=0.3, hand_points=120)
        found = balanced_icp.correct(scene.poses, points=1500, doubts=Doubts(faults.joint_rad, faults.encoder_rad))
        error = error_of(found.motion, scene.error)
        far.append(float(error @ np.linalg.solve(found.covariance, error)))
    assert np.mean(np.array(far) < chi2.ppf(0.95, 6)) >= 0.8
    assert np.median(far) > 0.4 * chi2.ppf(0.5, 6)
