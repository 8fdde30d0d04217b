"""Limbs of robots: what follows from frames, and what robots without limbs become."""

from __future__ import annotations

import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import Gripper, Limb, RobotJoint, RobotModel

ARM = """
<body name="{side}_upper"><joint name="{side}_elbow" type="hinge"/>
  <body name="{side}_hand"><joint name="{side}_wrist" type="hinge"/><site name="{side}_middle"/>
    <body name="{side}_finger"><joint name="{side}_bend" type="hinge"/><site name="{side}_pad"/></body>
  </body>
</body>
"""
TORSO = f"""
<mujoco><worldbody><body name="base"><body name="torso"><joint name="waist" type="hinge"/>
{ARM.format(side="l")}{ARM.format(side="r")}
</body></body></worldbody></mujoco>
"""


def joint(name: str, group: str) -> RobotJoint:
    return RobotJoint(name=name, group=group, lower=-1, upper=1, velocity=1, effort=1, home=0.1)  # type: ignore[arg-type]


def torso(**changed: object) -> RobotModel:
    sides = ("l", "r")
    links = {"base": "arm", "torso": "arm", **{f"{side}_upper": "arm" for side in sides}}
    fields: dict[str, object] = {
        "model": Folder(files={"robot.xml": TORSO.encode()}),
        "joints": (
            joint("waist", "arm"),
            *(joint(f"{side}_{name}", "arm") for side in sides for name in ("elbow", "wrist")),
            *(joint(f"{side}_bend", "hand") for side in sides),
        ),
        "links": {**links, **{f"{side}_{link}": "hand" for side in sides for link in ("hand", "finger")}},
        "frames": {"left_palm": "l_middle", "left_tip_1": "l_pad", "right_palm": "r_middle", "right_tip_1": "r_pad"},
        "source": "hand-made",
    }
    return RobotModel(**fields | changed)  # type: ignore[arg-type]


def test_limbs_follow_from_the_bodies_whatever_joints_are_called() -> None:
    robot = torso()
    assert robot.limb_names == ("left", "right")
    assert robot.limbs["left"].arm == ("waist", "l_elbow", "l_wrist")
    assert robot.limbs["right"].arm == ("waist", "r_elbow", "r_wrist")
    assert robot.limbs["right"].hand == ("r_bend",)
    assert robot.tips == ("left_tip_1", "right_tip_1")
    assert robot.limb_home("left") == {"waist": 0.1, "l_elbow": 0.1, "l_wrist": 0.1, "l_bend": 0.1}


def test_a_robot_whose_frames_name_no_side_has_one_limb() -> None:
    robot = torso(frames={"palm": "l_middle", "flange": "l_middle", "tip_thumb": "l_pad"})
    (limb,) = robot.limbs.values()
    assert robot.limb_names == ("arm",)
    assert (limb.palm, limb.tool, limb.tips, limb.thumb) == ("palm", "flange", ("tip_thumb",), "tip_thumb")
    assert limb.arm == ("waist", "l_elbow", "l_wrist")


@pytest.mark.parametrize("model", [{}, {"robot.xml": b"no mjcf"}, {"robot.xml": b"<mujoco/>"}])
def test_without_a_description_names_decide(model: dict[str, bytes]) -> None:
    robot = torso(model=Folder(files=model), frames={})
    assert robot.limbs["arm"].arm == ("waist", "l_elbow", "l_wrist", "r_elbow", "r_wrist")
    assert robot.limbs["arm"].hand == ("l_bend", "r_bend")


def test_a_gripper_has_a_finger_that_opposes_the_other() -> None:
    limb = Limb(arm=(), hand=("slide",), tips=("tip_a", "tip_b"), gripper=Gripper(joint="slide", open=0.04, closed=0.0))
    assert (limb.thumb, limb.fingers) == ("tip_a", ("tip_b",))
    hand = limb.model_copy(update={"gripper": None})
    assert (hand.thumb, hand.fingers) == (None, ("tip_a", "tip_b"))
