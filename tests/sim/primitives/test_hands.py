"""Which hand holds an object: contacts of a hand are that hand's, never the table's."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.task import TaskSpec
from dextera_build.sim.primitives.grasp import SUPPORT, Hands
from dextera_build.sim.primitives.lift.primitive import LiftGoal
from dextera_build.sim.primitives.state import GraspState, TaskState, opposed, together
from dextera_build.sim.primitives.success import holds
from tests import factories
from tests.sim.primitives.traces import grasped

FINGER = '<body name="{name}" pos="{place}"><geom type="box" size="0.01 0.03 0.02"/><site name="{name}"/></body>'
HAND = '<body name="{side}_wrist"><body name="{side}_hand"><site name="{side}_palm"/>{fingers}</body></body>'


def scene(left: dict[str, str], right: dict[str, str], table: bool = False) -> str:
    """A box of 80 mm among the fingers of two hands that are fixed in the world, perhaps on a table."""
    hands = ""
    for side, fingers in (("left", left), ("right", right)):
        made = "".join(FINGER.format(name=f"{side}_{name}", place=place) for name, place in fingers.items())
        hands += HAND.format(side=side, fingers=made)
    board = '<geom type="box" size="0.3 0.3 0.01" pos="0 0 -0.0499"/>' if table else ""
    return (
        '<mujoco><option cone="elliptic"/><worldbody><body name="box"><freejoint/>'
        '<geom type="box" size="0.04 0.04 0.04" mass="0.1"/></body>'
        f'<body name="base">{hands}</body>{board}</worldbody></mujoco>'
    )


def grasps(left: dict[str, str], right: dict[str, str], table: bool = False) -> dict[str, GraspState]:
    """Grasp states after a moment."""
    xml = scene(left, right, table)
    sides = {"left": left, "right": right}
    robot = RobotModel(
        model=Folder(files={"robot.xml": xml.encode()}),
        joints=(),
        links={"base": "arm"}
        | {f"{side}_{part}": kind for side in sides for part, kind in (("wrist", "arm"), ("hand", "hand"))},
        frames={f"{side}_palm": f"{side}_palm" for side in sides}
        | {f"{side}_tip_{name}": f"{side}_{name}" for side, fingers in sides.items() for name in fingers},
        source="hand-made",
    )
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 20)
    found: dict[str, Any] = Hands(model, robot).grasps(model, data, int(model.body("box").id))
    return found


def under(x: float, y: float) -> str:
    return f"{x} {y} -0.0599"


NONE: dict[str, str] = {}
FAR = {"index": "0.5 0 0"}


def test_the_other_hand_is_a_hand_and_not_the_table() -> None:
    found = grasps({"index": under(-0.03, 0.0), "middle": under(0.03, 0.0)}, FAR)
    assert found["left"].fingers == 2
    assert found["right"].fingers == 0
    assert not found["left"].supported
    assert not found["right"].supported
    assert [found[side].pushes.shape for side in ("left", "right")] == [(1, 3, 3), (1, 2, 3)], "with their palms"


def test_what_both_hands_carry_is_supported_by_neither() -> None:
    found = grasps({"index": under(-0.03, 0.0)}, {"index": under(0.03, 0.0)})
    assert [found[side].fingers for side in ("left", "right")] == [1, 1]
    assert not any(grasp.supported for grasp in found.values())


def test_a_table_supports_whatever_the_hands_do() -> None:
    found = grasps({"index": "-0.0499 0 0"}, {"index": "0.0499 0 0"}, table=True)
    assert all(grasp.supported for grasp in found.values())


def test_flat_hands_on_both_sides_hold_together_what_neither_holds() -> None:
    found = grasps({"index": "-0.0498 0 0"}, {"index": "0.0498 0 0"})
    assert not any(grasp.valid for grasp in found.values())
    both = together(found.values())
    assert both.fingers == 2
    assert both.opposing
    task = TaskSpec(name="Lift", object="box", goal=LiftGoal(height_m=0.1))
    still = np.zeros(1)
    slow = {side: GraspState(g.fingers, g.opposing, g.supported, still, g.pushes) for side, g in found.items()}
    start = TaskState(np.zeros(1), factories.pose()[None], grasps=found)
    now = TaskState(np.ones(1), factories.pose(z=0.2)[None], grasps=slow)
    assert holds(task, start, now)
    assert holds(task.model_copy(update={"limbs": ("left", "right")}), start, now)
    assert not holds(task.model_copy(update={"limbs": ("left",)}), start, now)


@pytest.mark.parametrize("turn", [0.0, 0.7, 2.0])
def test_forces_oppose_one_another_in_every_direction(turn: float) -> None:
    c, s = np.cos(turn), np.sin(turn)
    pairs = [[(c, s, 0.0), (-c, -s, 0.0)], [(c, s, 0.0), (-s, c, 0.0)], [(c, s, 0.0), (0.0, 0.0, 0.0)]]
    assert opposed(np.array(pairs)).tolist() == [True, False, False]
    assert not opposed(np.zeros((1, 0, 3)))


def test_a_hand_that_is_not_named_must_keep_off() -> None:
    hold = grasped(fingers=2, opposing=True, supported=False)
    touch = grasped(fingers=1, supported=False)
    time, pose = np.zeros(1), np.eye(4)[None]
    alone = TaskState(time, pose, grasps={"left": hold, "right": grasped(supported=False)})
    helped = TaskState(time, pose, grasps={"left": hold, "right": touch})
    assert alone.grasp(("left",)).alone
    assert alone.grasp().alone
    assert not alone.grasp(("right",)).alone
    assert not helped.grasp(("left",)).alone
    assert helped.grasp().alone


def test_all_links_of_a_tool_are_its_palm_and_none_of_the_arm_is() -> None:
    part = '<geom type="box" size="0.01 0.03 0.02"/>'
    xml = (
        '<mujoco><worldbody><body name="base"><body name="wrist"><joint name="turn"/>'
        f'{part}<body name="tool">{part}<body name="end" pos="0 0 0.1"><site name="palm"/><site name="tip"/></body>'
        "</body></body></body></worldbody></mujoco>"
    )
    links = {"base": "arm", "wrist": "arm", "tool": "hand", "end": "hand"}
    robot = RobotModel(
        model=Folder(files={"robot.xml": xml.encode()}),
        joints=(),
        links=links,
        frames={"palm": "palm", "tip_end": "tip"},
        source="hand-made",
    )
    model = mujoco.MjModel.from_xml_string(xml)
    hands = Hands(model, robot)
    owners = {model.body(model.geom_bodyid[geom]).name: int(hands.fingers[geom]) for geom in range(model.ngeom)}
    assert owners == {"wrist": SUPPORT, "tool": 1}
