"""Names in ROS 2 fit the robot, or the recipe is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from dextera_build.artifacts.robots.ros_names import RosNames
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests import task_bundles

RULE = "simulate.ros_names"


def made(tmp_path: Path, **options: Any) -> RosNames:
    found = RuleRunner(tmp_path).run(RULE, robot=task_bundles.robot(), options=options)
    assert isinstance(found, RosNames)
    return found


def test_a_recipe_that_states_nothing_takes_the_declared_names(tmp_path: Path) -> None:
    assert made(tmp_path) == RosNames()


def test_what_a_recipe_states_is_kept(tmp_path: Path) -> None:
    found = made(
        tmp_path,
        joints={"x": "rail"},
        flipped=["y"],
        controllers=[
            {"topic": "/arm", "kind": "forward", "joints": ["z", "y", "x"]},
            {"topic": "/hand", "joints": ["left", "right"]},
        ],
    )
    assert found.joints == {"x": "rail"}
    assert [each.joints for each in found.controllers] == [("z", "y", "x"), ("left", "right")]
    assert [each.kind for each in found.controllers] == ["forward", "trajectory"]


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"joints": {"elbow": "e"}}, "elbow are no joints of this robot"),
        ({"controllers": [{"topic": "/arm", "joints": ["x"]}]}, "left, right, y, z belong to no controller"),
        ({"controllers": [{"topic": "/arm"}, {"topic": "/hand", "joints": ["x"]}]}, "x belong to several controllers"),
    ],
)
def test_names_that_do_not_fit_are_refused(options: dict[str, Any], why: str, tmp_path: Path) -> None:
    with pytest.raises(RuleError, match=why):
        made(tmp_path, **options)
