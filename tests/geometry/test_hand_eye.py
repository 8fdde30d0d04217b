"""Hand-eye calibration: truth is found, its covariance is honest, and open motion shows in the singular values."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from dextera_build.geometry import boards, hand_eye, hand_eye_checks, hand_eye_refine, lie, transforms
from dextera_build.geometry.hand_eye import View
from tests.geometry.hand_eyes import Errors, error_of, grid, simulate

EXACT = Errors(0.0, 0.0, 0.0)


@pytest.mark.parametrize("in_hand", [False, True])
def test_without_errors_the_truth_is_found(in_hand: bool) -> None:
    views, setup, truth = simulate(3, 6, in_hand=in_hand, errors=EXACT)
    robot = np.stack([hand_eye.robot_side(view, setup) for view in views])
    start = hand_eye.closed_form(robot, np.stack([view.candidates[0] for view in views]))
    np.testing.assert_allclose(start.x, truth.x, atol=1e-9)
    np.testing.assert_allclose(start.y, truth.y, atol=1e-9)
    found = hand_eye_refine.refine(views, setup, start).solution
    np.testing.assert_allclose(found.x, truth.x, atol=1e-7)


@pytest.mark.parametrize("in_hand", [False, True])
def test_derivatives_are_those_of_the_corners(in_hand: bool) -> None:
    views, setup, truth = simulate(1, 3, in_hand=in_hand)
    plain = hand_eye.offsets(truth, views[0], setup).ravel()
    (by_x, by_y, by_robot, by_size), by_corner = hand_eye_refine._derivatives(views[0], setup, truth)
    for number in range(12):
        step = np.zeros(12)
        step[number] = 1e-6
        moved = hand_eye.offsets(hand_eye_refine.moved(truth, step), views[0], setup).ravel()
        analytic = (by_corner @ np.concatenate([by_x, by_y], axis=2)).reshape(-1, 12)[:, number]
        np.testing.assert_allclose((plain - moved) / 1e-6, analytic, atol=0.02)
    for number in range(6):
        step = np.zeros(6)
        step[number] = 1e-6
        error = transforms.rigid(lie.rotation(step[3:]), step[:3])
        other = View("", views[0].effector @ error, views[0].board, views[0].pixels, ())
        analytic = (by_corner @ by_robot).reshape(-1, 6)[:, number]
        np.testing.assert_allclose((plain - hand_eye.offsets(truth, other, setup).ravel()) / 1e-6, analytic, atol=0.02)
    larger = View("", views[0].effector, views[0].board * (1 + 1e-6), views[0].pixels, ())
    numeric = (plain - hand_eye.offsets(truth, larger, setup).ravel()) / 1e-6
    np.testing.assert_allclose(numeric, (by_corner @ by_size).ravel(), atol=0.02)


def test_a_single_markers_two_poses_are_told_apart_by_all_views_together() -> None:
    views, setup, truth = simulate(2, 8, board=boards.marker(0.05), away=False)
    wrong = transforms.rigid(lie.rotation(np.array([0.6, 0.3, 0.0])), np.zeros(3))
    both = [
        View(v.name, v.effector, v.board, v.pixels, (v.candidates[0] @ wrong, v.candidates[0])[:: 1 - 2 * (i % 2)])
        for i, v in enumerate(views)
    ]
    start, _ = hand_eye.start(both, setup)
    error = error_of(hand_eye_refine.refine(both, setup, start).solution.x, truth.x)
    assert np.linalg.norm(error[:3]) < 0.006


def test_a_chessboards_half_turn_is_settled_for_each_picture() -> None:
    views, setup, truth = simulate(5, 8)
    reverse = np.arange(len(views[0].board))[::-1]
    half = transforms.rigid(np.diag([-1.0, -1.0, 1.0]), grid().max(axis=0))
    turned = [
        View(v.name, v.effector, v.board, v.pixels[reverse], (v.candidates[0] @ half, v.candidates[0]), (reverse,))
        if number % 3 == 0
        else View(v.name, v.effector, v.board, v.pixels, (v.candidates[0], v.candidates[0] @ half), (reverse,))
        for number, v in enumerate(views)
    ]
    start, settled = hand_eye.start(turned, setup)
    found = hand_eye_refine.refine(settled, setup, start)
    assert np.linalg.norm(error_of(found.solution.x, truth.x)[:3]) < 0.003
    assert found.sigmas[0] < 0.4


def test_rotation_about_one_axis_shows_in_the_second_singular_value() -> None:
    views, setup, _ = simulate(1, 8, axes=(0.0, 0.0, 1.0))
    values, axes = hand_eye.turns(views, setup)
    assert np.degrees(values[0]) > 20
    assert np.degrees(values[1]) < 0.5
    views, setup, _ = simulate(1, 8)
    assert np.degrees(hand_eye.turns(views, setup)[0][1]) > 15
    assert np.linalg.norm(axes[0]) == pytest.approx(1.0)


def test_one_moved_picture_is_found_by_name_and_left_out() -> None:
    views, setup, truth = simulate(4, 9)
    moved = transforms.rigid(lie.rotation(np.array([0.0, 0.02, 0.0])), np.array([0.01, 0.0, 0.004]))
    bad = views[5]
    views[5] = View(bad.name, bad.effector @ moved, bad.board, bad.pixels, bad.candidates)
    start, views = hand_eye.start(views, setup)
    plain = hand_eye_refine.refine(views, setup, start)
    found = hand_eye_checks.checked(views, setup, start)
    assert [one.name for one in found.bad] == ["view_5"]
    good, naive = (np.linalg.norm(error_of(each.solution.x, truth.x)[:3]) for each in (found.refined, plain))
    assert good < 0.003 < naive


def test_a_board_of_another_size_is_measured() -> None:
    views, setup, _ = simulate(0, 10)
    larger = [View(v.name, v.effector, v.board * 1.05, v.pixels, v.candidates) for v in views]
    start, larger = hand_eye.start(larger, setup)
    scale, sigma = hand_eye_checks.board_scale(larger, setup, hand_eye_refine.refine(larger, setup, start))
    assert abs(scale - 1 / 1.05) < 3 * sigma < 0.015


@pytest.mark.parametrize("in_hand", [False, True])
@pytest.mark.medium
def test_the_stated_covariance_is_honest(in_hand: bool) -> None:
    """The benchmark has 400 draws of four setups; here the bounds are those of 40."""
    far, sigmas = [], []
    for seed in range(40):
        views, setup, truth = simulate(seed, 10, in_hand=in_hand)
        start, views = hand_eye.start(views, setup)
        found = hand_eye_refine.refine(views, setup, start)
        error = error_of(found.solution.x, truth.x)
        far.append(float(error @ np.linalg.solve(found.of_x, error)))
        sigmas.append(found.sigmas)
    inside = np.mean(np.array(far) < chi2.ppf(0.95, 6))
    assert inside >= 0.86
    assert np.median(far) > 0.5 * chi2.ppf(0.5, 6)  # not honest by being useless
    np.testing.assert_allclose(np.median(sigmas, axis=0), [0.2, 0.0005, 0.001], rtol=0.2)


def test_wrong_zeros_of_encoders_widen_the_covariance_as_they_move_the_answer() -> None:
    """A zero that is wrong in all views moves X by what `by_joints` says, and no residual tells it."""
    views, setup, _ = simulate(7, 9, errors=EXACT)
    start, views = hand_eye.start(views, setup)
    plain = hand_eye_refine.refine(views, setup, start)
    turn = lie.rotation_vector(np.eye(3)) + np.array([0.0, 0.0, 1e-3])
    about_base = transforms.rigid(lie.rotation(turn), np.zeros(3))
    moved = [View(v.name, about_base @ v.effector, v.board, v.pixels, v.candidates) for v in views]
    found = hand_eye_refine.refine(moved, setup, plain.solution)
    drifts = []
    for before, after in zip(views, moved, strict=True):
        gap = transforms.invert(before.effector) @ after.effector
        drifts.append(np.append(gap[:3, 3], lie.rotation_vector(gap[:3, :3]))[:, None] / 1e-3)
    spread = hand_eye_refine.by_joints(views, setup, plain, drifts, 1e-3)
    error = error_of(found.solution.x, plain.solution.x)
    np.testing.assert_allclose(np.sqrt(np.diag(spread)[:6]), np.abs(error), rtol=0.02, atol=2e-6)
    assert np.linalg.norm(error[3:]) == pytest.approx(1e-3, rel=0.02)
