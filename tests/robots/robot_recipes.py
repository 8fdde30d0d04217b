"""Robots out of the recipes that come with dxb, and states of their models."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.recipe import strict_yaml
from dextera_build.sim.model import robot as robots
from dextera_build.testing import RuleRunner

RECIPES = Path(__file__).parents[2] / "recipes" / "robot"


def described(name: str) -> dict[str, Any]:
    """The options of node `robot` in a recipe, as plain data."""
    file = RECIPES / f"{name}.yaml"
    node = strict_yaml.parse(file.read_text(), str(file)).plain()["nodes"]["robot"]
    return {key: value for key, value in node.items() if key not in ("rule", "like")}


def built(name: str, scratch: Path, rule: str = "simulate.robot", **inputs: RobotModel) -> RobotModel:
    """The robot of a recipe."""
    runner = RuleRunner(scratch)
    kind = runner.find(rule).rule.options
    options = kind.model_validate_json(json.dumps(described(name)))
    model: RobotModel = runner.run(rule, options=options.model_dump(), **inputs)
    return model


def compiled(robot: RobotModel) -> Any:
    """The compiled model of a robot, with its meshes."""
    return robots.load(robot.model).compile()


def at(model: Any, joints: Mapping[str, float]) -> Any:
    """State of the model at `joints` [rad]."""
    data = mujoco.MjData(model)
    for name, position in joints.items():
        data.joint(name).qpos[0] = position
    mujoco.mj_forward(model, data)
    return data


def touching(model: Any, data: Any) -> Counter[tuple[str, str]]:
    """Pairs of links that are pressed into each other, with the number of contacts."""
    pairs = (sorted(model.body(model.geom_bodyid[g]).name for g in contact.geom) for contact in data.contact)
    deep = [tuple(pair) for pair, contact in zip(pairs, data.contact, strict=True) if contact.dist < 0]
    return Counter((one, other) for one, other in deep)
