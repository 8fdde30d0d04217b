"""Whether a camera moved since its calibration."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import hand_eye, hand_eye_refine, lie, moved, transforms
from dextera_build.geometry.hand_eye import Setup, Solution, View
from tests.geometry.hand_eyes import simulate


def judged(seed: int, shift_m: float, turn_rad: float, pictures: int = 3) -> moved.Verdict:
    """A calibration from 10 pictures, and more pictures after the camera was moved."""
    views, setup, _ = simulate(seed, 10 + pictures)
    start, views = hand_eye.start(views[:10], setup)[0], views
    solution = hand_eye_refine.refine(views[:10], setup, start).solution
    residuals = np.array([hand_eye_refine.closing(view, setup, solution) for view in views[:10]])
    change = transforms.rigid(lie.rotation(np.array([0.0, turn_rad, 0.0])), np.array([shift_m, 0.0, 0.0]))
    expected, seen = [], []
    for view in views[10:]:
        expected.append(hand_eye.predicted(solution, view, setup))
        seen.append(change @ _alone(view, setup, solution))
    return moved.judge(np.array(expected), np.array(seen), residuals)


def _alone(view: View, setup: Setup, solution: Solution) -> np.ndarray:
    return hand_eye_refine.alone(view, setup, hand_eye.predicted(solution, view, setup))


@pytest.mark.medium
def test_a_camera_that_stayed_is_rarely_called_moved() -> None:
    verdicts = [judged(seed, 0.0, 0.0) for seed in range(30)]
    states = [verdict.state for verdict in verdicts]
    assert states.count("moved") <= 1
    assert states.count("unmoved") >= 22


def test_a_camera_that_moved_is_told_by_how_much() -> None:
    verdict = judged(1, 0.02, 0.0175)
    assert verdict.state == "moved"
    assert verdict.chance < 1e-6
    assert verdict.turn_rad == pytest.approx(0.0175, abs=4 * verdict.sigma_rad)
    np.testing.assert_allclose(verdict.motion[:3, 3], [0.02, 0.0, 0.0], atol=0.004)


def test_what_could_hide_in_the_errors_is_unsure() -> None:
    residuals = np.full((6, 2), [0.02, 0.03])
    still = np.tile(np.eye(4), (1, 1, 1))
    assert moved.judge(still, still, residuals).state == "unsure"
    assert moved.judge(still, still, residuals, notable=(0.2, 0.4)).state == "unmoved"
