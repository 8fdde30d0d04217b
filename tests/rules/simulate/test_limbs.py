"""What recipes say of limbs: grips, parallel grippers, roles of frames."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests.rules.simulate.test_robot import BALL, HINGE, LINK, PENDULUM

FINGERS = {
    "group": "hand",
    "mounts": ({"parent": "base", "prefix": "one_"}, {"parent": "base", "prefix": "other_"}),
    "links": (LINK | {"name": "finger", "joint": HINGE | {"name": "slide"}},),
}


def made(tmp_path: Path, limbs: dict[str, Any], **changed: Any) -> RobotModel:
    """A robot of two fingers on its base, with `limbs`."""
    frames = {
        "palm": {"link": "base"},
        "flange": {"link": "base"},
        "tip_one": {"link": "one_finger"},
        "tip_other": {"link": "other_finger"},
    }
    options = PENDULUM | {"chains": (PENDULUM["chains"][0], FINGERS), "frames": frames, "limbs": limbs} | changed
    robot: RobotModel = RuleRunner(tmp_path).run("simulate.robot", options=options)
    return robot


def test_a_parallel_gripper_is_a_hand_with_two_tips_and_its_own_pinch(tmp_path: Path) -> None:
    gripper = {"joint": "one_slide", "open": 0.5, "closed": -0.5}
    robot = made(tmp_path, {"right": {"gripper": gripper}})
    (limb,) = robot.limbs.values()
    assert robot.limb_names == ("right",)
    assert (limb.palm, limb.tool, limb.tips) == ("palm", "flange", ("tip_one", "tip_other"))
    assert limb.hand == ("one_slide", "other_slide")
    assert limb.thumb == "tip_one"
    assert limb.grips["pinch"].closed == {"one_slide": -0.5}
    # Fingers that press on one another would be in collision on the whole way to what they push.
    assert limb.grips["point"].open == {"one_slide": pytest.approx(-0.35)}


def test_a_gripper_pushes_with_the_sides_of_its_fingers_and_keeps_its_pinch_beside_a_stated_grip(
    tmp_path: Path,
) -> None:
    gripper = {"joint": "one_slide", "open": 0.5, "closed": -0.5}
    ball = BALL | {"radius_m": 0.03}
    finger = LINK | {"name": "finger", "joint": HINGE | {"name": "slide"}, "pieces": (ball,)}
    chains = (PENDULUM["chains"][0], FINGERS | {"links": (finger,)})
    robot = made(tmp_path, {"right": {"gripper": gripper}}, chains=chains)
    (limb,) = robot.limbs.values()
    # The corners of the box around a ball that the joint has turned by 0.35 rad.
    assert limb.grips["point"].tip_radius_m == pytest.approx(0.03 * (np.cos(0.35) + np.sin(0.35)))
    own = {"against": "nothing", "open_rad": {"one_slide": 0.0}, "tip_radius_m": 0.02}
    (stated,) = made(tmp_path / "stated", {"right": {"gripper": gripper, "grips": {"point": own}}}).limbs.values()
    assert stated.grips["pinch"] == limb.grips["pinch"]
    assert stated.grips["point"].tip_radius_m == 0.02


def test_without_options_limbs_follow_from_frames(tmp_path: Path) -> None:
    assert made(tmp_path, {}).limb_names == ("arm",)


@pytest.mark.parametrize(
    ("limbs", "message"),
    [
        ({"right": {"palm": "centre"}}, "limb `right` has no frame `centre`"),
        ({"right": {"gripper": {"joint": "one_slide", "open": 9.0}}}, "opens beyond the limits of `one_slide`"),
        (
            {"right": {"tips": ("tip_one",), "gripper": {"joint": "one_slide", "open": 0.1}}},
            "the gripper of `right` has 1 fingertips, not two",
        ),
        (
            {"right": {"grips": {"pinch": {"against": "thumb", "open_rad": {"lift": 0.0}}}}},
            "grip `pinch` moves `lift`, which is not a joint of the hand",
        ),
        ({"left": {}, "right": {}}, "no frame is the palm of limb `right`"),
    ],
)
def test_wrong_limbs_are_refused(tmp_path: Path, limbs: dict[str, Any], message: str) -> None:
    chain = PENDULUM["chains"][0]
    lifted = (*chain["links"], LINK | {"name": "column", "joint": HINGE | {"name": "lift"}})
    with pytest.raises(RuleError) as error:
        made(tmp_path, limbs, chains=(chain | {"links": lifted}, FINGERS))
    assert message in error.value.message


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"limbs": {"right": {"gripper": {"joint": "one_slyde", "open": 0.1}}}},
            "`limbs` right, gripper: no joint is called `one_slyde`; did you mean `one_slide`?",
        ),
        (
            {"limbs": {"right": {"grips": {"pinch": {"against": "thumb", "open_rad": {"elbow": 0.0}}}}}},
            "`limbs` right, grip pinch: no joint is called `elbow`; joints: one_slide, other_slide",
        ),
        (
            {"grips": {"pinch": {"against": "thumb", "open_rad": {}, "closed_rad": {"elbow": 0.0}}}},
            "`grips` pinch: no joint is called `elbow`; joints: one_slide, other_slide",
        ),
    ],
)
def test_joints_that_the_robot_lacks_are_refused_before_anything_is_built(
    tmp_path: Path, options: dict[str, Any], message: str
) -> None:
    kind = RuleRunner(tmp_path).find("simulate.robot").rule.options
    whole = PENDULUM | {"chains": (PENDULUM["chains"][0], FINGERS), "frames": {}} | options
    with pytest.raises(ValidationError) as error:
        kind.model_validate(whole)
    assert message in str(error.value)
