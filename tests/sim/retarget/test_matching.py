"""Correspondence of hands: from names, from a recipe, and from geometry alone."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.robots.hand_map import HandMap
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.errors import RuleError
from dextera_build.geometry import hands
from dextera_build.sim.retarget.matching import matched
from tests.hand_motions import motion


def stating(robot: RobotModel, limb: str, **fields: object) -> RobotModel:
    return robot.model_copy(update={"hands": {limb: HandMap(**fields)}})


def without_grips(robot: RobotModel) -> RobotModel:
    bare = {name: limb.model_copy(update={"grips": {}}) for name, limb in robot.limbs.items()}
    return robot.model_copy(update={"limbs": bare})


def renamed(robot: RobotModel) -> RobotModel:
    """A LEAP Hand whose fingertips are called by numbers."""
    names = {"tip_thumb": "tip_0", "tip_index": "tip_1", "tip_middle": "tip_2", "tip_ring": "tip_3"}
    limb = robot.limbs["arm"].model_copy(update={"tips": tuple(names[role] for role in robot.limbs["arm"].tips)})
    frames = {names.get(role, role): site for role, site in robot.frames.items()}
    return robot.model_copy(update={"frames": frames, "limbs": {"arm": limb}})


def test_sides_fingers_and_sizes_of_the_shipped_hands(leap: RobotModel, revo: RobotModel) -> None:
    one = matched(leap, "arm")
    assert (one.side, [hands.FINGERS[each] for each in one.fingers]) == ("right", ["thumb", "index", "middle", "ring"])
    assert one.length_m == pytest.approx(0.140, abs=0.001)
    for side in hands.SIDES:
        other = matched(revo, side)
        assert (other.side, len(other.fingers)) == (side, 5)
        assert other.length_m == pytest.approx(0.074, abs=0.001)


def test_the_axes_are_a_rotation_that_points_fingers_along_fingers(hand) -> None:
    robot, limb = hand
    own = matched(robot, limb)
    assert own.turn.T @ own.turn == pytest.approx(np.eye(3))
    assert np.linalg.det(own.turn) == pytest.approx(1.0)
    tips = own.hand.at(own.straight).tips
    # At zero, the fingers of the Revo 2 are bent by 18 deg as published.
    assert (tips[1:].mean(axis=0) - own.anchor) @ -own.turn[:, 2] > 0.94 * own.length_m
    order = (tips[1:] - tips[1]) @ own.across
    assert (np.diff(order) > 0.01).all()


def test_without_grips_the_geometry_says_where_the_palm_faces(hand) -> None:
    robot, limb = hand
    plain, bare = matched(robot, limb), matched(without_grips(robot), limb)
    assert bare.side == plain.side
    off = np.degrees(np.arccos((np.trace(plain.turn.T @ bare.turn) - 1) / 2))
    assert off < 12


def test_tips_of_any_name_are_fingers_that_the_recipe_states(leap: RobotModel) -> None:
    fingers = {"ring": "tip_3", "thumb": "tip_0", "index": "tip_1", "middle": "tip_2"}
    own, plain = matched(stating(renamed(leap), "arm", fingers=fingers), "arm"), matched(leap, "arm")
    assert own.fingers == plain.fingers
    assert own.straight == pytest.approx(plain.straight)


def test_a_stated_direction_wins_over_that_of_a_grip(leap: RobotModel) -> None:
    tilted = (np.cos(0.1), 0.0, -np.sin(0.1))
    own = matched(stating(leap, "arm", pointing=tilted), "arm")
    assert -own.turn[:, 2] == pytest.approx(tilted)
    assert own.turn[:, 1] @ own.turn[:, 2] == pytest.approx(0.0)


def test_the_scale_follows_from_the_operators_size_or_is_stated(leap: RobotModel) -> None:
    _, points, _ = motion(30.0)
    lengths = hands.finger_lengths(points[0])
    own = matched(leap, "arm")
    usual = own.beside(lengths).scale
    assert own.beside(1.1 * lengths).scale == pytest.approx(usual / 1.1)
    stated = matched(stating(leap, "arm", scale=1.6), "arm")
    assert stated.beside(lengths).scale == 1.6
    assert stated.beside(lengths, 1.2).scale == 1.2


def test_a_hand_of_unknown_fingers_is_refused(leap: RobotModel) -> None:
    with pytest.raises(RuleError, match="limb `arm` has no hand that an operator's hand can move") as caught:
        matched(renamed(leap), "arm")
    assert caught.value.code == "DXB-B520"
    assert caught.value.facts == {"palm": "palm", "fingertips": "tip_0, tip_1, tip_2, tip_3"}
    assert "`hands: {arm: {fingers: {thumb: ..., index: ...}}}`" in caught.value.hint


@pytest.mark.parametrize(
    "fields", [{"side": "left"}, {"facing": (0.0, 0.0, 1.0), "side": "right"}], ids=["side", "facing"]
)
def test_a_right_hand_is_not_taken_for_a_left_one(leap: RobotModel, fields: dict[str, object]) -> None:
    with pytest.raises(RuleError, match=r"the hand of limb `arm` is a .* one, but `.*` is stated") as caught:
        matched(stating(leap, "arm", **fields), "arm")
    assert caught.value.code == "DXB-B521"
    assert "facing leaves the palm" in caught.value.hint


def test_a_palm_that_faces_along_its_fingers_is_refused(leap: RobotModel) -> None:
    with pytest.raises(RuleError, match="the palm of limb `arm` faces along its fingers") as caught:
        matched(stating(leap, "arm", pointing=(0.2, 0.0, -1.0)), "arm")
    assert caught.value.code == "DXB-B522"
    assert caught.value.facts["facing"] == "0 0 -1"
