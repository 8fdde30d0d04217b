"""What recipes say of an operator's hands, on a gripper whose fingers turn."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests.robots.robot_recipes import described
from tests.rules.simulate.test_limbs import made

GRIPPER = {"fingers": {"thumb": "tip_one", "index": "tip_other"}, "facing": (0, 1, 0), "pointing": (0, 0, 1)}


@pytest.mark.medium
def test_a_stated_hand_is_kept_told_and_shown(tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path)
    plain = described("kuka_leap") | {"hands": {"arm": {"side": "right", "scale": 1.5}}}
    options = runner.find("simulate.robot").rule.options.model_validate_json(json.dumps(plain))
    robot: RobotModel = runner.run("simulate.robot", options=options.model_dump())
    assert robot.hands["arm"].scale == 1.5
    home, opened, pinch = sorted(runner.outcome.previews, key=lambda each: len(each[0]))
    assert home[0] == "at home"
    assert opened[0].startswith(
        "hand of `arm`, open: the operator's right hand, thumb, index, middle, ring; fingers of 140 mm"
    )
    assert pinch[0].startswith("hand of `arm`, thumb and index: the operator's right hand")
    assert pinch[0].endswith("scale 1.50; in a pinch the thumb comes to index 1 mm, middle 1 mm, ring 1 mm")
    assert opened[1] != pinch[1]


@pytest.mark.parametrize(
    ("hands", "message"),
    [
        ({"left": {}}, "`hands`: the robot has no limb `left`"),
        ({"arm": {"fingers": {"thumb": "tip_won"}}}, "`hands` arm: no frame is called `tip_won`, the tip of the thumb"),
        ({"arm": {}}, "limb `arm` has no hand that an operator's hand can move"),
        ({"arm": GRIPPER | {"pointing": (0, 1, 0)}}, "the palm of limb `arm` faces along its fingers"),
    ],
)
def test_wrong_hands_are_refused(tmp_path: Path, hands: dict[str, Any], message: str) -> None:
    with pytest.raises(RuleError) as error:
        made(tmp_path, {}, hands=hands)
    assert message in error.value.message


def test_a_finger_that_no_operator_has_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValidationError, match="'thumb', 'index', 'middle', 'ring' or 'pinky'"):
        made(tmp_path, {}, hands={"arm": {"fingers": {"sixth": "tip_one"}}})
