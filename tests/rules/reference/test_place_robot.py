"""reference.place_robot: a robot stands near the place that its twin has for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.scenes.world import World
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import RuleError
from dextera_build.geometry import transforms
from dextera_build.testing import RuleRunner
from tests import factories
from tests.rules.reference import test_place_robot_in_view

TWIN_FROM_TRUTH = factories.pose(0.07, -0.04, 0.003, yaw=0.2)
"""T_world_reference: the twin's world is another than the true one."""


def support() -> object:
    """What the twin knows of the camera."""
    camera = TWIN_FROM_TRUTH @ test_place_robot_in_view.world().camera_pose.matrix
    return factories.support().model_copy(update={"camera_pose": factories.placed(camera, "camera")})


def base(x: float = 0.1, y: float = 0.7, z: float = -0.2, yaw: float = -1.2) -> Pose:
    return factories.placed(factories.pose(x, y, z, yaw), "base")


def installed(tmp_path: Path, place: Pose, **options: object) -> World:
    runner = RuleRunner(tmp_path)
    made = runner.run(
        "reference.place_robot", world=test_place_robot_in_view.world(), support=support(), base=place, options=options
    )
    assert isinstance(made, World)
    return made


def test_without_an_error_the_robot_stands_where_the_twin_has_it(tmp_path: Path) -> None:
    made = installed(tmp_path, base(), error_m=0.0, error_deg=0.0, joints_deg={"lean": 90.0})
    assert made.stand is not None
    assert TWIN_FROM_TRUTH @ made.stand.pose().matrix == pytest.approx(base().matrix, abs=1e-9)
    assert made.stand.joints == {"lean": pytest.approx(np.pi / 2)}
    assert made.objects.keys() == test_place_robot_in_view.world().objects.keys()
    assert np.array_equal(made.camera_pose.matrix, test_place_robot_in_view.world().camera_pose.matrix)


def test_beside_the_table_it_stands_on_a_pedestal_that_ends_below_it(tmp_path: Path) -> None:
    made = installed(tmp_path, base(), error_m=0.0, error_deg=0.0)
    assert made.fixtures["pedestal"].surface.vertices[:, 2].max() == pytest.approx(-0.2 - 0.003 - 0.001, abs=1e-6)
    assert made.fixtures["pedestal"].surface.vertices[:, 2].min() == pytest.approx(-0.74, abs=1e-6)
    assert "pedestal" not in installed(tmp_path, base(0.0, 0.0, 0.0)).fixtures


@pytest.mark.medium
def test_errors_have_the_stated_size_and_follow_from_the_seed(tmp_path: Path) -> None:
    offs = []
    for seed in range(8):
        stand = installed(tmp_path, base(), error_m=0.02, error_deg=2.0, seed=seed).stand
        assert stand is not None
        off = transforms.invert(base().matrix) @ TWIN_FROM_TRUTH @ stand.pose().matrix
        offs.append([*(off[:3, 3] / 0.02), np.degrees(np.arctan2(off[1, 0], off[0, 0])) / 2.0])
        assert off[2, 2] == pytest.approx(1.0)
    assert np.sqrt(np.square(offs).mean()) == pytest.approx(1.0, abs=0.35)
    assert installed(tmp_path, base(), error_m=0.02, error_deg=2.0, seed=7).stand == stand


def test_a_second_robot_and_other_frames_are_refused(tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path)
    made = installed(tmp_path, base())
    with pytest.raises(RuleError, match="this world has a robot already"):
        runner.run("reference.place_robot", world=made, support=support(), base=base())
    wrong = factories.placed(base().matrix, "base", "camera")
    with pytest.raises(RuleError, match="the place is T_camera_base, but T_world_base is needed"):
        runner.run("reference.place_robot", world=test_place_robot_in_view.world(), support=support(), base=wrong)
