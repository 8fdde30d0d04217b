"""Two OpenArms with Revo 1 or Revo 2 hands, on the compiled model."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.sim.control.hand import HandKinematics
from tests.robots.robot_recipes import at, built, compiled, touching

FINGERS = ("index", "middle", "ring", "little")


@pytest.fixture(scope="module")
def revo1(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return built("openarm_revo1", tmp_path_factory.mktemp("robot"))


@pytest.fixture(scope="module")
def revo2(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return built("openarm_revo2", tmp_path_factory.mktemp("robot"))


@pytest.fixture(scope="module", params=["revo1", "revo2"])
def robot(request: pytest.FixtureRequest) -> RobotModel:
    made: RobotModel = request.getfixturevalue(request.param)
    return made


@pytest.fixture(scope="module")
def model(robot: RobotModel) -> Any:
    return compiled(robot)


def mirrored(robot: RobotModel, random: np.random.Generator) -> dict[str, float]:
    """Joint positions [rad] at which the left arm and hand are the mirror image of the right."""
    right = {j.name: float(random.uniform(j.lower, j.upper)) for j in robot.joints if j.name.startswith("right_")}
    # OpenArm counts every joint but the elbow the other way round on the left.
    turned = {f"right_joint_{number}" for number in (1, 2, 3, 5, 6, 7)}
    left = {f"left_{name.removeprefix('right_')}": -p if name in turned else p for name, p in right.items()}
    return {**right, **left}


@pytest.mark.medium
def test_each_side_has_seven_joints_and_six_motors(robot: RobotModel, model: Any) -> None:
    for side in ("left", "right"):
        assert sum(name.startswith(side) for name in robot.names("arm")) == 7
        assert sum(name.startswith(side) for name in robot.names("hand")) == 6
        assert sum(follower.name.startswith(side) for follower in robot.followers) in (4, 5)  # Revo 2's thumb has one
    assert [model.actuator(number).name for number in range(model.nu)] == [joint.name for joint in robot.joints]
    assert (model.nu, model.nq) == (26, 26 + len(robot.followers))


def test_figures_of_the_data_sheets(revo1: RobotModel) -> None:
    robot, model = revo1, compiled(revo1)
    hand = [name for name, group in robot.links.items() if group == "hand" and name.startswith("left_")]
    assert sum(model.body(name).mass[0] for name in hand) == pytest.approx(0.540, abs=0.005)
    limits = {joint.name: np.degrees([joint.lower, joint.upper]) for joint in robot.joints}
    np.testing.assert_allclose(limits["left_index_flexion"], [0, 70], atol=0.01)
    np.testing.assert_allclose(limits["right_thumb_flexion"], [0, 55], atol=0.01)
    np.testing.assert_allclose(limits["right_thumb_rotation"], [0, 90], atol=0.01)
    data = at(model, dict.fromkeys(robot.home, 0.0))
    reach = data.site("right_flange").xpos[2] - data.site("right_tip_middle").xpos[2]
    assert reach + 0.0075 == pytest.approx(0.183, abs=0.003)
    arm = [name for name in robot.links if name in {f"right_link_{number}" for number in range(7)}]
    assert sum(model.body(name).mass[0] for name in arm) == pytest.approx(5.362, abs=0.001)


@pytest.mark.parametrize(("name", "larger"), [("revo1", 0.183 / 0.1597), ("revo2", 1.0)])
def test_the_proportions_of_the_hand_are_those_of_revo_2(request: Any, name: str, larger: float) -> None:
    """159.7 mm long, thumb 52 + 27 mm from the joint of flexion, middle finger 37 mm, index finger 32 mm."""
    robot = request.getfixturevalue(name)
    model = compiled(robot)
    for finger, link_m in (("index", 0.032), ("middle", 0.037), ("little", 0.029)):
        assert np.linalg.norm(model.body(f"left_{finger}_distal").pos) == pytest.approx(link_m * larger, abs=1e-4)
    data = at(model, dict.fromkeys(robot.home, 0.0))
    thumb = data.site("right_tip_thumb").xpos - data.body("right_thumb_proximal").xpos
    pad = 0.0095 if name == "revo1" else 0.0
    assert np.linalg.norm(thumb) + pad == pytest.approx((0.052 + 0.0265) * larger, abs=0.002)
    ratios = {each.name.removeprefix("left_"): each.ratio for each in robot.followers if each.name.startswith("left_")}
    thumbs = {} if name == "revo1" else {"thumb_bend": 1.0945}
    assert ratios == {"index_bend": 1.131, "middle_bend": 1.267, "ring_bend": 1.252, "little_bend": 1.271} | thumbs


def test_published_figures_of_revo_2(revo2: RobotModel) -> None:
    model = compiled(revo2)
    hand = [name for name, group in revo2.links.items() if group == "hand" and name.startswith("left_")]
    assert sum(model.body(name).mass[0] for name in hand) == pytest.approx(0.390, abs=0.001)
    joints = {joint.name.removeprefix("left_"): joint for joint in revo2.joints}
    for name, upper, effort in (
        ("ring_flexion", 1.41, 2),
        ("thumb_flexion", 1.0472, 1.1),
        ("thumb_rotation", 1.55334, 0.5),
    ):
        assert (joints[name].lower, joints[name].upper, joints[name].effort) == (0, upper, effort)
    data = at(model, dict.fromkeys(revo2.home, 0.0))
    reach = data.site("right_flange").xpos[2] - data.site("right_tip_middle").xpos[2]
    assert reach == pytest.approx(0.1597, abs=0.004)


@pytest.mark.parametrize("side", ["left", "right"])
def test_pads_meet_in_front_of_the_palm(robot: RobotModel, side: str) -> None:
    """The tips of a grip come so close that nothing fits between their surfaces, and do not pass each other before."""
    hand = HandKinematics(robot, side)
    for name in ("tripod", "pinch"):
        grip = robot.limbs[side].grips[name]
        opened, closed = hand.posture(grip.open), hand.posture({**grip.open, **grip.closed})
        pressing = hand.pressing(opened, closed)
        ways = [opened + part * (closed - opened) for part in np.linspace(0, 1, 21)]
        assert hand.thumb is not None
        gaps = [np.linalg.norm(hand.tip(hand.thumb, way) - hand.reach(way, pressing)) for way in ways]
        assert gaps[0] > 0.06
        assert min(gaps) < 2 * grip.tip_radius_m
        assert (np.diff(gaps[: int(np.argmin(gaps))]) < 0).all()


@pytest.mark.parametrize("seed", range(4))
def test_one_side_mirrors_the_other(robot: RobotModel, model: Any, seed: int) -> None:
    joints = mirrored(robot, np.random.default_rng(seed))
    data = at(model, robot.followed(joints))
    for frame in ("flange", "palm", "tip_thumb", *(f"tip_{finger}" for finger in FINGERS)):
        left, right = data.site(f"left_{frame}").xpos, data.site(f"right_{frame}").xpos
        np.testing.assert_allclose(left * [1, -1, 1], right, atol=1e-6, err_msg=frame)
        assert robot.frames[f"right_{frame}"] == f"right_{frame}"
        np.testing.assert_array_equal(data.site(frame).xpos, right)  # without a side: the right hand


def test_palms_face_down_on_level_forearms_and_thumbs_oppose(robot: RobotModel, model: Any) -> None:
    level = robot.home | {"left_joint_4": np.pi / 2, "right_joint_4": np.pi / 2}
    data = at(model, level)
    assert data.site("left_palm").xmat.reshape(3, 3)[2, 0] < -0.99
    normal = data.site("right_palm").xmat.reshape(3, 3)[:, 0].copy()
    assert normal[2] < -0.99
    opposed = at(model, level | {"right_thumb_rotation": 1.55})
    ahead = (opposed.site("right_tip_thumb").xpos - opposed.site("right_palm").xpos) @ normal
    assert ahead > 0.03


@pytest.mark.parametrize("rotation", [0.0, 1.55])
def test_nothing_touches_at_home_nor_while_the_fingers_close(robot: RobotModel, model: Any, rotation: float) -> None:
    turned = {name: rotation for name in robot.home if name.endswith("rotation")}
    for share in np.linspace(0, 0.8, 9):
        bent = {name: 1.22 * share for name in robot.home if name.endswith(tuple(f"{f}_flexion" for f in FINGERS))}
        data = at(model, robot.followed(robot.home | turned | bent))
        assert not touching(model, data), share


def test_it_holds_itself_at_home(robot: RobotModel, model: Any) -> None:
    data = at(model, robot.followed(robot.home))
    for name, position in robot.home.items():
        data.actuator(name).ctrl[0] = position
    worst = 0.0
    for _ in range(int(5.0 / model.opt.timestep)):
        mujoco.mj_step(model, data)
        worst = max(worst, *(abs(data.joint(name).qpos[0] - position) for name, position in robot.home.items()))
    assert worst < 0.05
    assert np.abs(data.qvel).max() < 1e-3


def test_distal_joints_follow(robot: RobotModel, model: Any) -> None:
    """While a finger closes as fast as it can, and when it is pushed at its tip."""
    data = at(model, robot.followed(robot.home))
    for name, position in robot.home.items():
        data.actuator(name).ctrl[0] = 1.1 if name.endswith(tuple(f"{f}_flexion" for f in FINGERS)) else position
    worst = 0.0
    for step in range(1000):
        if step > 600:
            data.body("right_index_distal").xfrc_applied[:3] = [0.0, 3.0, 0.0]
        mujoco.mj_step(model, data)
        for follower in robot.followers:
            wanted = follower.ratio * data.joint(follower.leader).qpos[0] + follower.offset
            worst = max(worst, abs(data.joint(follower.name).qpos[0] - wanted))
    assert worst < 0.02
    assert data.joint("left_middle_flexion").qpos[0] == pytest.approx(1.1, abs=0.01)
    assert data.joint("left_middle_bend").qpos[0] == pytest.approx(1.267 * 1.1, abs=0.02)


def test_links_and_frames_exist(robot: RobotModel, model: Any) -> None:
    assert {model.body(number).name for number in range(1, model.nbody)} == set(robot.links)
    assert {model.site(number).name for number in range(model.nsite)} == set(robot.frames.values())
    assert model.nmesh == 0
