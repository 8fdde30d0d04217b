"""Where a page first looks from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.geometry import transforms
from dextera_build.sim.runtime.environment import Environment
from dextera_build.teleop import viewpoint
from dextera_build.testing import RuleRunner
from tests import hand_tasks
from tests.robots.robot_recipes import built


def seen(bundle: TaskBundle, eye: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, int]:
    """What is looked at, the chosen eye, and how many targets are hidden from it or from another one, in the base."""
    environment = Environment(bundle)
    environment.begin(environment.start)
    palms = environment.palm_poses()[:, :3]
    look, chosen = viewpoint.first(environment, palms)
    base = bundle.base_pose.matrix
    targets = [*transforms.apply(base, palms), environment.data.body(environment.task.object).xpos]
    from_eye = chosen if eye is None else look + eye
    return look, chosen, viewpoint._hidden(environment, transforms.apply(base, from_eye), targets)


@pytest.mark.slow
def test_two_hands_are_seen_from_behind_over_the_torso(runner: RuleRunner, tmp_path: Path) -> None:
    bundle = hand_tasks.lift_can(runner, built("openarm_revo1", tmp_path), ["left", "right"])
    look, eye, hidden = seen(bundle)
    assert hidden == 0
    assert eye[0] < look[0]
    assert abs(eye[1] - look[1]) < 1e-9
    assert seen(bundle, viewpoint.AWAY_M * np.array([-1.0, 0.0, 0.0]))[2] > 0


@pytest.mark.medium
def test_one_hand_is_seen_from_ahead(lifting: TaskBundle) -> None:
    look, eye, hidden = seen(lifting)
    assert hidden == 0
    assert eye[0] > look[0]
    assert np.linalg.norm(eye - look) == pytest.approx(viewpoint.AWAY_M)
