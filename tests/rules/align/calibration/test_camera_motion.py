"""align.camera_motion: a camera that stayed, one that moved, and one of which nothing can be said."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.cameras.calibration import Calibration
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.errors import RuleError
from dextera_build.geometry import hand_eye, lie, poses, transforms
from dextera_build.testing import RuleRunner
from tests.rules.align.calibration import boards


@cache
def pictures(shift_m: float = 0.0, turn_rad: float = 0.0) -> tuple[RobotViews, RobotViews, np.ndarray]:
    """Eight pictures for a calibration, three more after the camera was moved, and T_camera_now."""
    views, truth = boards.taken(boards.CHARUCO, seed=6, count=11)
    assert views.effectors is not None
    now = transforms.rigid(lie.rotation(np.array([0.0, turn_rad, 0.0])), np.array([shift_m, 0.0, 0.0]))
    captures = dict(views.captures)
    for number, name in enumerate(list(captures)[8:], start=8):
        board = poses.to_matrix(views.effectors[number]) @ truth.y
        pose = transforms.invert(now) @ transforms.invert(truth.x) @ board
        captures[name] = boards.capture(boards.drawn(boards.CHARUCO, pose, number))
    names = list(captures)
    parts = [
        views.model_copy(update={"captures": {n: captures[n] for n in chosen}, "effectors": views.effectors[rows]})
        for chosen, rows in ((names[:8], slice(0, 8)), (names[8:], slice(8, 11)))
    ]
    return parts[0], parts[1], now


@pytest.fixture(scope="module")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    found = RuleRunner(tmp_path_factory.mktemp("before")).run("align.hand_eye", views=pictures()[0])
    assert isinstance(found, Calibration)
    return found


@pytest.mark.medium
def test_a_camera_that_stayed_is_unmoved(tmp_path: Path, calibration: Calibration) -> None:
    _, after, _ = pictures()
    runner = RuleRunner(tmp_path)
    runner.run("align.camera_motion", views=after, calibration=calibration)
    assert runner.outcome.metrics["verdict"][0] == 0
    assert runner.outcome.line.startswith("unmoved")


def test_a_camera_that_moved_by_two_centimetres_is_told_where_it_is(tmp_path: Path, calibration: Calibration) -> None:
    _, after, now = pictures(0.02, 0.0175)
    runner = RuleRunner(tmp_path)
    found = runner.run("align.camera_motion", views=after, calibration=calibration)
    assert runner.outcome.metrics["verdict"][0] == 1
    assert (found.parent, found.child) == ("camera", "camera_now")
    gap = hand_eye.apart(now, found.matrix)
    assert gap < 0.012
    assert np.linalg.norm(found.matrix[:3, 3] - now[:3, 3]) < 4 * np.sqrt(np.trace(found.covariance[:3, :3]))
    assert "moved" in runner.outcome.warnings[0]


def test_errors_in_which_a_motion_could_hide_are_unsure(tmp_path: Path, calibration: Calibration) -> None:
    _, after, _ = pictures()
    runner = RuleRunner(tmp_path)
    runner.run("align.camera_motion", views=after, calibration=calibration, options={"notable_m": 0.0002})
    assert runner.outcome.metrics["verdict"][0] == 2


def test_a_calibration_without_residuals_says_nothing(tmp_path: Path, calibration: Calibration) -> None:
    _, after, _ = pictures()
    bare = calibration.model_copy(update={"residuals": None})
    with pytest.raises(RuleError, match="no residuals"):
        RuleRunner(tmp_path).run("align.camera_motion", views=after, calibration=bare)


def test_the_stub_says_unmoved(tmp_path: Path, calibration: Calibration) -> None:
    _, after, _ = pictures()
    runner = RuleRunner(tmp_path)
    runner.run("align.camera_motion", backend="stub", profile="stub", views=after, calibration=calibration)
    assert runner.outcome.line.startswith("unmoved")
