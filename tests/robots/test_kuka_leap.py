"""The KUKA iiwa 7 with a LEAP Hand, on the compiled model."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.recipe import strict_yaml
from dextera_build.testing import RuleRunner

RECIPE = Path(__file__).parents[2] / "recipes" / "robot" / "kuka_leap.yaml"
# Classical Denavit-Hartenberg table of the LBR iiwa 7 R800: d [m] and alpha [rad]; a is 0 throughout.
D = (0.340, 0.0, 0.400, 0.0, 0.400, 0.0, 0.126)
ALPHA = np.pi / 2 * np.array([-1, 1, 1, -1, -1, 1, 0])
LIMITS_DEG = (170, 120, 170, 120, 170, 120, 175)


def described() -> dict[str, Any]:
    """The options in the recipe, as plain data."""
    node = strict_yaml.parse(RECIPE.read_text(), str(RECIPE)).plain()["nodes"]["robot"]
    return {name: value for name, value in node.items() if name != "rule"}


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    runner = RuleRunner(tmp_path_factory.mktemp("robot"))
    kind = runner.find("simulate.robot").rule.options
    options = kind.model_validate_json(json.dumps(described()))
    model: RobotModel = runner.run("simulate.robot", options=options.model_dump())
    return model


@pytest.fixture(scope="module")
def model(robot: RobotModel) -> Any:
    return mujoco.MjModel.from_xml_string(robot.model.files["robot.xml"].decode())


def at(model: Any, joints: dict[str, float]) -> Any:
    """State of the model at `joints` [rad]."""
    data = mujoco.MjData(model)
    for name, position in joints.items():
        data.joint(name).qpos[0] = position
    mujoco.mj_forward(model, data)
    return data


def denavit_hartenberg(angles: np.ndarray) -> np.ndarray:
    """T_base_flange (4, 4) of seven joint angles [rad]."""
    pose = np.eye(4)
    for angle, d, alpha in zip(angles, D, ALPHA, strict=True):
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        pose = pose @ np.array([[c, -s * ca, s * sa, 0], [s, c * ca, -c * sa, 0], [0, sa, ca, d], [0, 0, 0, 1]])
    return pose


@pytest.mark.medium
@pytest.mark.parametrize("seed", range(6))
def test_the_flange_is_where_the_dh_table_says(robot: RobotModel, model: Any, seed: int) -> None:
    angles = np.random.default_rng(seed).uniform(-1.6, 1.6, 7) if seed else np.zeros(7)
    data = at(model, dict(zip(robot.names("arm"), angles.tolist(), strict=True)))
    wanted = denavit_hartenberg(angles)
    flange = data.site(robot.frames["flange"])
    np.testing.assert_allclose(flange.xpos, wanted[:3, 3], atol=1e-3)  # the URDF rounds the wrist offset to 0.1 mm
    np.testing.assert_allclose(flange.xmat.reshape(3, 3)[:, 2], wanted[:3, 2], atol=1e-5)


def test_joints_and_limits_are_those_of_the_data_sheet(robot: RobotModel, model: Any) -> None:
    assert len(robot.names("arm")) == 7
    assert len(robot.names("hand")) == 16
    assert model.nu == model.nq == 23
    for name, degrees in zip(robot.names("arm"), LIMITS_DEG, strict=True):
        np.testing.assert_allclose(np.degrees(model.joint(name).range), [-degrees, degrees], atol=0.01)


def test_actuators_stand_in_the_order_of_the_joints(robot: RobotModel, model: Any) -> None:
    assert [model.actuator(i).name for i in range(model.nu)] == [joint.name for joint in robot.joints]
    for joint in robot.joints:
        assert model.actuator(joint.name).forcerange[1] == pytest.approx(joint.effort)
        np.testing.assert_allclose(model.actuator(joint.name).ctrlrange, [joint.lower, joint.upper])


def test_home_is_within_limits_and_nothing_touches(robot: RobotModel, model: Any) -> None:
    for joint in robot.joints:
        assert joint.lower <= joint.home <= joint.upper
    assert at(model, robot.home).ncon == 0


def test_a_folded_hand_touches_itself(robot: RobotModel, model: Any) -> None:
    thumb = {"th_cmc": 1.6, "th_axl": 1.3, "th_mcp": 1.0, "th_ipl": 1.2}
    fist = {f"{finger}_{joint}": 1.3 for finger in ("if", "mf") for joint in ("mcp", "pip", "dip")}
    assert at(model, robot.home | fist | thumb).ncon > 0


@pytest.mark.parametrize("opposed", [0.9, 1.5])
def test_fingers_close_freely(robot: RobotModel, model: Any, opposed: float) -> None:
    """Until they reach the palm; the thumb stands at home or further across."""
    joints = ("mcp", "pip", "dip")
    for angle in np.linspace(0, 1.3, 14):
        bent = {f"{finger}_{joint}": float(angle) for finger in ("if", "mf", "rf") for joint in joints}
        assert at(model, robot.home | bent | {"th_cmc": opposed, "th_mcp": -0.2, "th_ipl": 0.0}).ncon == 0, angle


def test_masses_are_near_the_published_ones(robot: RobotModel, model: Any) -> None:
    arm = sum(model.body(name).mass[0] for name, group in robot.links.items() if group == "arm")
    hand = sum(model.body(name).mass[0] for name, group in robot.links.items() if group == "hand")
    assert arm == pytest.approx(23.9, rel=0.1)  # data sheet of the R800; the URDF's links add up to 26.0
    assert hand == pytest.approx(0.746, abs=0.001)


def test_inertias_are_physical(model: Any) -> None:
    for inertia in model.body_inertia[1:]:
        assert inertia.min() > 0
        assert 2 * inertia.max() <= inertia.sum() * 1.001


def test_frames_and_links_exist_in_the_model(robot: RobotModel, model: Any) -> None:
    assert {model.site(name).name for name in robot.frames.values()} == set(robot.frames.values())
    assert {model.body(i).name for i in range(1, model.nbody)} == set(robot.links)
    assert {"flange", "palm", "tip_index", "tip_middle", "tip_ring", "tip_thumb"} <= set(robot.frames)


def test_fingers_point_away_from_the_flange(robot: RobotModel, model: Any) -> None:
    data = at(model, dict.fromkeys(robot.home, 0.0))
    flange = data.site("flange")
    for finger in ("index", "middle", "ring"):
        reach = (data.site(f"tip_{finger}").xpos - flange.xpos) @ flange.xmat.reshape(3, 3)[:, 2]
        assert 0.22 < reach < 0.30


def test_no_mesh_file_is_needed(robot: RobotModel, model: Any) -> None:
    assert list(robot.model.files) == ["robot.xml"]
    assert model.nmesh == 0


def test_it_holds_itself_at_home(robot: RobotModel, model: Any) -> None:
    data = at(model, robot.home)
    for name, position in robot.home.items():
        data.actuator(name).ctrl[0] = position
    for _ in range(1000):
        mujoco.mj_step(model, data)
    drift = max(abs(data.joint(name).qpos[0] - position) for name, position in robot.home.items())
    assert drift < 0.05
    assert np.abs(data.qvel).max() < 0.05
