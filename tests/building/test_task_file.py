"""Tasks that are proposed for the objects of a twin."""

from __future__ import annotations

import json

from dextera_build.building import task_file
from dextera_build.recipe import strict_yaml
from dextera_build.sim.primitives import catalogue
from rules.simulate.task.task import TaskOptions, parameters_of
from tests import factories

ASSETS = {
    "red_box": factories.box_asset(factories.pose(0.1, 0.0), size=(0.04, 0.04, 0.05)),
    "long_box": factories.box_asset(factories.pose(-0.1, 0.0), size=(0.05, 0.40, 0.21)),
    "bowl": factories.bowl_asset(factories.pose(0.3, 0.1), radius=0.08, height=0.06),
    "laptop": factories.laptop_asset(factories.pose(-0.4, 0.0), opening=1.9),
}


def test_what_is_proposed_follows_from_shape_and_joints() -> None:
    names = [proposal.name for proposal in task_file.proposals(ASSETS)]
    assert names == [
        "LiftBowl",
        "PushBowl",
        "CloseLaptop",
        "LiftLongBox",
        "LiftRedBox",
        "PushRedBox",
        "PlaceRedBoxInBowl",
    ]


def test_the_recipe_can_be_read_and_its_tasks_are_valid() -> None:
    text = task_file.text("twin/mine", "robot/mine", ASSETS)
    recipe = strict_yaml.parse(text, "mine.yaml").plain()
    nodes = recipe["nodes"]
    assert recipe["inputs"]["scene"] == "twin/mine:scene"
    assert recipe["targets"]["default"] == [name for name in nodes if name != "base"]
    for name in recipe["targets"]["default"]:
        given = {key: value for key, value in nodes[name].items() if not str(value).startswith("$") and key != "rule"}
        options = TaskOptions.model_validate_json(json.dumps(given))
        assert options.primitive in catalogue.KINDS
        assert parameters_of(options) is not None
