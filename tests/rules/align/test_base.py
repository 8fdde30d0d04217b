"""align.base: a chain of two transforms, or a chosen place."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests import factories

SUPPORT = factories.support()


def test_a_measured_base_is_taken_through_the_camera(tmp_path: Path) -> None:
    world_from_base = factories.pose(0.3, 0.5, -0.02, 2.0)
    measured = Pose(parent="camera", child="base", matrix=np.linalg.inv(SUPPORT.camera_pose.matrix) @ world_from_base)
    runner = RuleRunner(tmp_path)
    found = runner.run("align.base", support=SUPPORT, measured=measured, options={"position_m": (9.0, 9.0, 9.0)})
    assert (found.parent, found.child) == ("world", "base")
    np.testing.assert_allclose(found.matrix, world_from_base, atol=1e-12)
    assert runner.outcome.line == "base at 0.300, 0.500, -0.020 m, yaw 114.6 deg, leaning 0.00 deg, measured"


def test_a_chosen_base_stands_upright_where_told(tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path)
    found = runner.run("align.base", support=SUPPORT, options={"position_m": (0.1, 0.4, 0.0), "yaw_deg": 90.0})
    np.testing.assert_allclose(found.matrix, factories.pose(0.1, 0.4, 0.0, np.pi / 2), atol=1e-12)
    assert "chosen" in runner.outcome.line


def test_somebody_has_to_say_where_the_robot_stands(tmp_path: Path) -> None:
    with pytest.raises(RuleError, match="the robot's base has no pose") as error:
        RuleRunner(tmp_path).run("align.base", support=SUPPORT)
    assert "`position_m`" in str(error.value.hint)


def test_a_transform_of_other_frames_is_refused(tmp_path: Path) -> None:
    other = Pose(parent="base", child="camera", matrix=np.eye(4))
    with pytest.raises(RuleError, match="T_base_camera, but T_camera_base is needed"):
        RuleRunner(tmp_path).run("align.base", support=SUPPORT, measured=other)


def test_a_measured_base_has_no_place_in_a_world_of_unknown_scale(tmp_path: Path) -> None:
    measured = Pose(parent="camera", child="base", matrix=np.eye(4))
    unknown = SUPPORT.model_copy(update={"scale": "unknown"})
    with pytest.raises(RuleError, match="the scale of this twin is unknown") as caught:
        RuleRunner(tmp_path).run("align.base", support=unknown, measured=measured)
    assert "input `robot` of `align.support`" in str(caught.value.hint)
