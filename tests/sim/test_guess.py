"""Roles guessed from how links hang together."""

from __future__ import annotations

from typing import Any

import mujoco
import pytest

from dextera_build.sim.model.imported import guess
from dextera_build.sim.model.imported.urdf import Source


def chain(parent: Any, names: list[str], joints: bool = True) -> Any:
    """Bodies in series, with a hinge each."""
    for name in names:
        parent = parent.add_body(name=name)
        if joints:
            parent.add_joint(name=f"j_{name}")
    return parent


def arm(parent: Any, side: str = "") -> Any:
    return chain(parent, [f"{side}link{n}" for n in range(1, 8)])


def fingers(palm: Any, names: list[str], length: int) -> None:
    for name in names:
        chain(palm, [f"{name}_{n}" for n in range(length)])


def source() -> tuple[Source, Any]:
    spec = mujoco.MjSpec()
    return Source(spec), spec.worldbody.add_body(name="root")


def test_an_arm_alone_ends_in_its_flange():
    found, root = source()
    chain(arm(root), ["tool0"], joints=False)
    assert guess.roles(found, "root") == guess.Guess(frames={"flange": "tool0"})


@pytest.mark.parametrize("length", [2, 4])
def test_a_hand_alone_is_a_hand(length):
    found, root = source()
    fingers(root, ["th", "if", "mf"], length)
    made = guess.roles(found, "root")
    assert made.hand == ["base"]
    assert made.frames == {
        "palm": "base",
        **{
            f"tip_{name}": f"{link}_{length - 1}" for name, link in (("thumb", "th"), ("index", "if"), ("middle", "mf"))
        },
    }


def test_a_hand_on_an_arm_begins_where_the_chain_branches():
    found, root = source()
    palm = chain(arm(root), ["mount", "palm"], joints=False)
    fingers(palm, ["thumb", "index", "a"], 3)
    made = guess.roles(found, "root")
    assert made.hand == ["palm"]
    tips = {"tip_thumb": "thumb_2", "tip_index": "index_2", "tip_3": "a_2"}
    assert made.frames == {"palm": "palm", "flange": "mount"} | tips


def test_two_arms_have_a_side_each():
    found, root = source()
    for side in ("left_", "right_"):
        palm = chain(arm(root, side), [f"{side}palm"], joints=False)
        fingers(palm, [f"{side}inner", f"{side}outer"], 1)
    made = guess.roles(found, "root")
    assert made.hand == ["left_palm", "right_palm"]
    assert made.frames["left_flange"] == "left_link7"
    assert made.frames["right_tip_outer"] == made.frames["tip_outer"] == "right_outer_0"
    assert len(made.frames) == 12


@pytest.mark.parametrize(
    ("limits", "mimics", "wanted"),
    [
        ((0.0, 0.04), {"j_right": ("j_left", 1.0, 0.0)}, ("j_left", 0.04, 0.0)),
        ((-0.03, 0.001), {"j_left": ("j_right", -1.0, 0.0)}, ("j_right", -0.03, 0.001)),
        ((0.0, 0.04), {}, None),
    ],
)
def test_a_parallel_gripper_has_one_sliding_joint_that_the_other_finger_follows(limits, mimics, wanted):
    found, root = source()
    palm = chain(arm(root), ["palm"], joints=False)
    for name in ("left", "right"):
        body = palm.add_body(name=name)
        body.add_joint(name=f"j_{name}", type=mujoco.mjtJoint.mjJNT_SLIDE, range=limits)
    found.mimics.update(mimics)
    assert guess.roles(found, "root").gripper == wanted


def test_a_hand_of_hinges_is_no_parallel_gripper():
    found, root = source()
    fingers(chain(arm(root), ["palm"], joints=False), ["left", "right"], 1)
    found.mimics["j_right_0"] = ("j_left_0", 1.0, 0.0)
    assert guess.roles(found, "root").gripper is None
