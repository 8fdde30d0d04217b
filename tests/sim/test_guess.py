"""Roles guessed from how links hang together, from names and from shapes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
import pytest

from dextera_build.errors import RuleError
from dextera_build.geometry import quaternions
from dextera_build.sim.model.imported import guess, hands
from dextera_build.sim.model.imported.source import Source

SLIDE = mujoco.mjtJoint.mjJNT_SLIDE


def link(parent: Any, name: str, joint: str = "", **options: Any) -> Any:
    """A box of 20 mm edge, 100 mm above its parent, with a hinge about y if `joint` is named."""
    body = parent.add_body(name=name, pos=options.pop("pos", [0, 0, 0.1]))
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=options.pop("size", [0.01] * 3), mass=0.1, contype=0)
    if joint:
        body.add_joint(name=joint, axis=options.pop("axis", [0, 1, 0]), limited=True, range=[-1.5, 1.5], **options)
    return body


def chain(parent: Any, names: list[str], joints: bool = True) -> Any:
    for name in names:
        parent = link(parent, name, f"j_{name}" if joints else "")
    return parent


def arm(parent: Any, side: str = "") -> Any:
    """Seven links, of which the last turns about z."""
    body = chain(parent, [f"{side}link{n}" for n in range(1, 7)])
    return link(body, f"{side}link7", f"j_{side}link7", axis=[0, 0, 1])


def fingers(palm: Any, names: list[str], length: int) -> None:
    for number, name in enumerate(names):
        body = link(palm, f"{name}_0", f"j_{name}_0", pos=[0, 0.03 * number, 0.1])
        chain(body, [f"{name}_{n}" for n in range(1, length)])


def slides(palm: Any, limits: tuple[float, float], axes: Mapping[str, float]) -> None:
    """Fingers of 60 x 10 x 20 mm that slide along y by `axes`, their inner sides 10 mm from the middle at 0."""
    for name, (side, axis) in zip(axes, zip((1, -1), axes.values(), strict=True), strict=True):
        body = palm.add_body(name=name, pos=[0, side * 0.015, 0.05])
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.01, 0.005, 0.03], pos=[0, 0, 0.03], mass=0.1, contype=0)
        body.add_joint(name=f"j_{name}", type=SLIDE, axis=[0, axis, 0], limited=True, range=limits)


def source() -> tuple[Source, Any]:
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    root = spec.worldbody.add_body(name="root")
    root.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.05] * 3, contype=0)
    return Source(spec), root


def links(found: guess.Guess) -> dict[str, str]:
    return {role: each.spot.link for role, each in found.frames.items()}


def test_an_arm_alone_pushes_with_its_end():
    found, root = source()
    tool = chain(arm(root), ["tool0"], joints=False)
    made = guess.roles(found, "root")
    tips = ("tip_front", "tip_back", "tip_left", "tip_right")
    assert links(made) == dict.fromkeys(("flange", "palm", *tips), "tool0")
    assert [made.frames[role].confidence for role in ("flange", "palm", *tips)] == ["certain", *5 * ["unsure"]]
    # The link that turns is the hand, because it touches what the arm pushes.
    assert (made.hand, made.grippers, made.pointing, made.tools) == (["link7"], {}, ["arm"], ["arm"])
    # The last joint turns about z, and the box of the tool ends 10 mm beyond its origin.
    ends = np.array([made.frames[role].spot.at for role in tips])
    np.testing.assert_allclose(ends[:, 2], 0.01, atol=1e-9)
    np.testing.assert_allclose(ends[0] + ends[1], [0, 0, 0.02], atol=1e-9)
    assert np.linalg.norm(ends[0] - ends[1]) == pytest.approx(np.linalg.norm(ends[2] - ends[3]))
    np.testing.assert_allclose(quaternions.to_matrix(made.frames["palm"].spot.turn)[:, 2], [0, 0, 1], atol=1e-9)
    assert tool.name == "tool0"


def test_the_sides_of_a_tool_are_where_its_shapes_are():
    box = np.array([[x, y, 0.0] for x in (-0.04, 0.04) for y in (-0.02, 0.02)])
    sides = hands.rim(box, np.zeros(3), np.eye(3))
    np.testing.assert_allclose(sides["tip_front"], (0.04, 0.0), atol=1e-12)
    np.testing.assert_allclose(sides["tip_right"], (0.0, -0.02), atol=1e-12)
    # Between two fingers there is nothing that pushes.
    fingers = np.concatenate([box * [0.1, 1, 1] + [0.07, 0, 0], box * [0.1, 1, 1] - [0.07, 0, 0]])
    x, y = hands.rim(fingers, np.zeros(3), np.eye(3))["tip_left"]
    assert (abs(x), y) == pytest.approx((0.07, 0.02))


@pytest.mark.parametrize("length", [2, 4])
def test_a_hand_alone_is_a_hand(length):
    found, root = source()
    fingers(root, ["th", "if", "mf"], length)
    made = guess.roles(found, "root")
    tips = {
        f"tip_{name}": f"{link}_{length - 1}" for name, link in (("thumb", "th"), ("index", "if"), ("middle", "mf"))
    }
    assert made.hand == ["base"]
    assert links(made) == {"palm": "base", **tips}


@pytest.mark.medium
def test_a_hand_on_an_arm_begins_where_the_chain_branches():
    found, root = source()
    palm = chain(arm(root), ["mount", "palm"], joints=False)
    fingers(palm, ["thumb", "index", "a"], 3)
    made = guess.roles(found, "root")
    assert made.hand == ["palm"]
    tips = {"tip_thumb": "thumb_2", "tip_index": "index_2", "tip_3": "a_2"}
    assert links(made) == {"palm": "palm", "flange": "mount"} | tips
    assert made.frames["tip_3"].confidence == "unsure"
    assert made.frames["tip_thumb"].confidence == "likely"


@pytest.mark.medium
def test_two_arms_have_a_side_each():
    found, root = source()
    for side in ("left_", "right_"):
        palm = chain(arm(root, side), [f"{side}palm"], joints=False)
        fingers(palm, [f"{side}inner", f"{side}outer"], 1)
    made = guess.roles(found, "root")
    assert made.hand == ["left_palm", "right_palm"]
    known = links(made)
    assert known["left_flange"] == "left_link7"
    assert known["right_tip_outer"] == known["tip_outer"] == "right_outer_0"
    assert len(known) == 12


@pytest.mark.medium
def test_fingers_of_two_arms_are_called_left_and_right():
    found, root = source()
    for side in ("left/", "right/"):
        slides(arm(root, side), (0.0, 0.04), {f"{side}{name}": axis for name, axis in (("left", 1), ("right", -1))})
    made = links(guess.roles(found, "root"))
    for side in ("left", "right"):
        assert made[f"{side}_tip_left"] == f"{side}/left"
        assert made[f"{side}_tip_right"] == f"{side}/right"


def test_the_only_joint_of_a_file_moves_a_jaw():
    found, root = source()
    link(chain(root, ["stator"], joints=False), "mover", "turn")
    made = guess.roles(found, "root")
    assert links(made) == {"flange": "stator", "palm": "stator", "tip_fixed": "stator", "tip_jaw": "mover"}
    assert made.grippers["arm"][0] == "turn"
    assert made.frames["palm"].why.startswith("joint `turn` is the only one")


def test_wheels_and_a_head_are_no_part_of_the_arm():
    found, root = source()
    for name in ("wheel_left", "wheel_right"):
        link(root, name, f"j_{name}")
    torso = link(root, "torso", "lift", type=SLIDE)
    chain(torso, ["head_1", "head_2"])
    palm = chain(arm(torso), ["palm"], joints=False)
    fingers(palm, ["thumb", "index"], 2)
    made = guess.roles(found, "root")
    assert made.hand == ["palm"]
    assert made.still == ["j_head_1", "j_head_2", "j_wheel_left", "j_wheel_right"]
    assert "lift" in made.home


@pytest.mark.medium
def test_legs_are_no_arms():
    found, root = source()
    for side in ("left", "right"):
        chain(root, [f"{side}_{name}_link" for name in ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle", "toe")])
        fingers(chain(arm(root, f"{side}_"), [f"{side}_palm"], joints=False), [f"{side}_inner", f"{side}_outer"], 1)
    made = guess.roles(found, "root")
    assert made.hand == ["left_palm", "right_palm"]
    assert len(made.still) == 12
    assert "j_left_knee_link" in made.still


@pytest.mark.parametrize(
    "names",
    [("fl_hip", "fl_uleg", "fl_lleg"), ("FR_leg", "upper_1", "lower_1"), ("l_shank_pitch",), ("abduction", "foot")],
)
def test_a_robot_of_legs_alone_has_no_hand(names):
    found, root = source()
    for number in range(4):
        chain(link(root, f"mount_{number}"), [f"{name}_{number}" for name in names])
    with pytest.raises(RuleError, match=r"no arm or hand: its moving links are legs, mount_0, mount_1, "):
        guess.roles(found, "root")


def test_a_walking_robot_has_the_arm_on_its_back():
    found, root = source()
    for side in ("fl", "fr", "hl", "hr"):
        chain(root, [f"{side}_hip", f"{side}_uleg", f"{side}_lleg"])
    link(arm(root), "arm_link_fngr", "arm_f1x")
    made = guess.roles(found, "root")
    assert links(made) == {"flange": "link7", "palm": "link7", "tip_fixed": "link7", "tip_jaw": "arm_link_fngr"}
    assert made.grippers["arm"][0] == "arm_f1x"
    assert len(made.still) == 12


@pytest.mark.parametrize(
    ("limits", "axes", "mimics", "wanted", "followers"),
    [
        ((0.0, 0.04), (1, -1), {"j_right": ("j_left", 1.0, 0.0)}, ("j_left", 0.04, 0.0), {}),
        ((-0.009, 0.03), (-1, -1), {"j_left": ("j_right", -1.0, 0.0)}, ("j_right", 0.03, -0.009), {}),
        ((0.0, 0.04), (1, -1), {}, ("j_left", 0.04, 0.0), {"j_right": ("j_left", 1.0)}),
    ],
)
def test_a_parallel_gripper_has_one_joint_and_tips_on_its_inner_sides(limits, axes, mimics, wanted, followers):
    found, root = source()
    slides(chain(arm(root), ["palm"], joints=False), limits, dict(zip(("left", "right"), axes, strict=True)))
    found.mimics.update(mimics)
    made = guess.roles(found, "root")
    assert made.grippers == {"arm": wanted}
    assert made.followers == followers
    assert made.home[wanted[0]] == wanted[1]
    for role, side in (("tip_left", 1), ("tip_right", -1)):
        np.testing.assert_allclose(made.frames[role].spot.at, [0, -side * 0.005, 0.06 - 0.004], atol=1e-9)
    axis = quaternions.to_matrix(made.frames["palm"].spot.turn)
    np.testing.assert_allclose(axis[:, 2], [0, 0, 1], atol=1e-9)
    np.testing.assert_allclose(np.abs(axis[:, 1]), [0, 1, 0], atol=1e-9)


@pytest.mark.medium
def test_a_linkage_that_one_joint_moves_is_a_gripper_of_its_two_longest_chains():
    found, root = source()
    palm = chain(arm(root), ["palm"], joints=False)
    fingers(palm, ["left", "right"], 2)
    for number, name in enumerate(("support_left", "support_right")):
        link(palm, name, f"j_{name}", pos=[0, 0.03 * number, 0.05])
    for name in ("left_1", "right_0", "right_1", "support_left", "support_right"):
        found.mimics[f"j_{name}"] = ("j_left_0", 1.0, 0.0)
    made = guess.roles(found, "root")
    assert made.grippers["arm"][0] == "j_left_0"
    assert links(made) == {"palm": "palm", "flange": "link7", "tip_left": "left_1", "tip_right": "right_1"}


@pytest.mark.medium
def test_one_moving_finger_is_a_jaw_if_its_name_says_so():
    for name, hand in (("gripper", True), ("link8", False)):
        found, root = source()
        palm = arm(root)
        jaw = palm.add_body(name=name, pos=[0, 0.01, 0.03])
        jaw.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.01, 0.005, 0.03], pos=[0, 0.005, 0.03], mass=0.1)
        jaw.add_joint(name=f"j_{name}", axis=[-1, 0, 0], limited=True, range=[-0.1, 1.7])
        made = guess.roles(found, "root")
        assert bool(made.grippers) is hand
        if hand:
            joint, opened, closed = made.grippers["arm"]
            assert (joint, closed) == ("j_gripper", -0.1)
            assert opened == pytest.approx(1.1)  # opens away from the fixed side, by no more than 1.2 rad
            assert links(made) == {"flange": "link7", "palm": "link7", "tip_fixed": "link7", "tip_jaw": "gripper"}
            # Closed, both tips are at the same place.
            assert made.frames["tip_jaw"].spot.at[1] == pytest.approx(0.0, abs=2e-3)


def test_home_looks_down_in_front_of_the_base():
    found, root = source()
    slides(chain(arm(root), ["palm"], joints=False), (0.0, 0.04), {"left": 1, "right": -1})
    found.mimics["j_right"] = ("j_left", 1.0, 0.0)
    made = guess.roles(found, "root")
    model = found.spec.compile()
    data = mujoco.MjData(model)
    for name, position in made.home.items():
        data.joint(name).qpos[0] = position
    mujoco.mj_kinematics(model, data)
    axis = data.body("palm").xmat.reshape(3, 3)[:, 2]
    assert axis[2] < -0.8
    assert data.body("palm").xpos[0] > 0.1
