"""Tasks that are proposed for the objects of a twin."""

from __future__ import annotations

import json

from dextera_build.artifacts.robots.limb import Grip, Gripper
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.building import task_file
from dextera_build.code.loader import Library
from dextera_build.recipe import strict_yaml
from dextera_build.sim.primitives import folders
from rules.simulate.task.task import TaskOptions
from tests import episodes, factories

ASSETS = {
    "red_box": factories.box_asset(factories.pose(0.1, 0.0), size=(0.04, 0.04, 0.05)),
    "long_box": factories.box_asset(factories.pose(-0.1, 0.0), size=(0.05, 0.40, 0.21)),
    "bowl": factories.bowl_asset(factories.pose(0.3, 0.1), radius=0.08, height=0.06),
    "laptop": factories.laptop_asset(factories.pose(-0.4, 0.0), opening=1.9),
}


def test_what_is_proposed_follows_from_shape_and_joints() -> None:
    names = [task.proposal.name for task in task_file.tasks(Library(), ASSETS)]
    assert names == [
        "LiftBowl",
        "PushBowl",
        "CloseLaptop",
        "LiftLongBox",
        "LiftRedBox",
        "PlaceRedBoxInBowl",
        "PushRedBox",
    ]


def test_the_recipe_can_be_read_and_its_tasks_are_valid() -> None:
    text = task_file.text("twin/mine", "robot/mine", ASSETS, task_file.tasks(Library(), ASSETS))
    recipe = strict_yaml.parse(text, "mine.yaml").plain()
    nodes = recipe["nodes"]
    assert recipe["inputs"]["scene"] == "twin/mine:scene"
    assert recipe["targets"]["default"] == [name for name in nodes if nodes[name]["rule"] == "simulate.task"]
    assert recipe["targets"]["shown"] == [task_file.shown(name) for name in recipe["targets"]["default"]]
    assert {nodes[name]["bundle"] for name in recipe["targets"]["shown"]} == {
        f"${name}" for name in recipe["targets"]["default"]
    }
    for name in recipe["targets"]["default"]:
        given = {key: value for key, value in nodes[name].items() if not str(value).startswith("$") and key != "rule"}
        own = given.pop(given["primitive"])
        assert TaskOptions.model_validate_json(json.dumps(given)).primitive == given["primitive"]
        folders.module(given["primitive"], "primitive").Options.model_validate_json(json.dumps(own))


def test_tasks_say_whether_a_hand_has_to_hold_the_object() -> None:
    found = [task.proposal for task in task_file.tasks(Library(), ASSETS)]
    assert [each.name for each in found if not each.holds] == ["PushBowl", "CloseLaptop", "PushRedBox"]


def test_a_robot_holds_with_a_gripper_or_with_a_grip_against_something() -> None:
    robot = episodes.robot()
    limb = robot.limbs["arm"]
    pushes = Grip(against="nothing", open={})

    def with_(**fields: object) -> RobotModel:
        return robot.model_copy(update={"limbs": {"arm": limb.model_copy(update=fields)}})

    assert not task_file.holds(with_(grips={"point": pushes}))
    assert task_file.holds(with_(grips={"point": pushes, "pinch": Grip(against="thumb", open={})}))
    assert task_file.holds(with_(gripper=Gripper(joint="joint_3", open=0.1, closed=0.0)))
