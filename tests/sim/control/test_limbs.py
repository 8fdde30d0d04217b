"""Two arms: each moves alone, both are solved together, and the fingers of each are its own."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import Follower, RobotJoint, RobotModel
from dextera_build.sim.control.hand import HandKinematics
from dextera_build.sim.control.ik import ArmKinematics
from dextera_build.sim.control.operator import Aim, Command, PoseControl
from tests import factories
from tests.robots import robot_recipes


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return robot_recipes.built("openarm_revo1", tmp_path_factory.mktemp("robot"))


def test_poses_are_those_of_the_whole_robot(robot: RobotModel) -> None:
    arms = ArmKinematics(robot, ("left", "right"))
    random = np.random.default_rng(0)
    joints = np.clip(arms.home + random.normal(0, 0.3, len(arms.home)), arms.lower, arms.upper)
    data = robot_recipes.at(
        robot_recipes.compiled(robot), robot.followed(robot.home | dict(zip(arms.joints, joints, strict=True)))
    )
    for pose, role in zip(arms.poses(joints), ("left_palm", "right_palm"), strict=True):
        assert np.allclose(pose[:3, 3], data.site(role).xpos, atol=1e-5)
        assert np.allclose(pose[:3, :3], data.site(role).xmat.reshape(3, 3), atol=1e-5)


def test_both_palms_are_brought_to_their_targets_at_once(robot: RobotModel) -> None:
    arms = ArmKinematics(robot, ("left", "right"))
    wanted = np.clip(arms.home + np.random.default_rng(1).normal(0, 0.2, len(arms.home)), arms.lower + 0.05, arms.upper)
    found = arms.solve(arms.poses(wanted), restarts=2)
    assert found.reached()
    assert np.allclose(arms.poses(found.joints), arms.poses(wanted), atol=0.01)


def test_a_limb_that_is_not_commanded_stays(robot: RobotModel) -> None:
    control = PoseControl(robot, 20.0)
    home = np.array([joint.home for joint in robot.joints])
    control.begin(home)
    left = control.arms(("left",))
    pose = left.pose(left.home)
    pose[:3, 3] += [0.0, 0.0, 0.03]
    fingers = np.full(len(robot.limbs["left"].hand), 0.3)
    command = Command({"left": Aim(pose, fingers)}, "approach")
    for _ in range(30):
        targets = control.follow(command)
    moved = {
        joint.name for joint, one, other in zip(robot.joints, home, targets, strict=True) if abs(one - other) > 1e-9
    }
    assert moved <= {*robot.limbs["left"].arm, *robot.limbs["left"].hand}
    assert moved >= set(robot.limbs["left"].hand)
    assert control.lag_m(command) < 0.002


def test_hands_are_mirror_images_and_their_last_links_follow(robot: RobotModel) -> None:
    left, right = HandKinematics(robot, "left"), HandKinematics(robot, "right")
    posture = np.array([0.6, 0.5, 0.4, 0.3, 1.2, 0.2])
    for one, other in zip(left.fingers, right.fingers, strict=True):
        assert np.allclose(left.tip(one, posture) * [1, -1, 1], right.tip(other, posture), atol=1e-6)
    data = robot_recipes.at(
        robot_recipes.compiled(robot), robot.followed(robot.home | dict(zip(left.joints, posture, strict=True)))
    )
    palm = data.site("left_palm")
    seen = palm.xmat.reshape(3, 3).T @ (data.site("left_tip_index").xpos - palm.xpos)
    assert np.allclose(left.tip("left_tip_index", posture), seen, atol=1e-6)


COUPLED = """
<mujoco><compiler angle="radian"/><worldbody><body name="base">
<body name="one"><joint name="one" axis="0 1 0" range="-2 2"/>
<geom size="0.02" mass="0.1"/>
<body name="two" pos="0.3 0 0"><joint name="two" axis="0 1 0"/><geom size="0.02" mass="0.1"/>
<body name="three" pos="0.3 0 0"><joint name="three" axis="0 1 0" range="-2 2"/><geom size="0.02" mass="0.1"/>
<body name="slider" pos="0.1 0 0"><joint name="slider" type="slide" axis="1 0 0" range="0 0.1"/>
<geom size="0.02" mass="0.1"/><site name="palm"/></body></body></body></body></body></worldbody>
<equality><joint name="two" joint1="two" joint2="one" polycoef="0.1 -1.5 0 0 0"/></equality></mujoco>
"""


def test_a_coupled_joint_of_an_arm_keeps_its_coupling_and_a_sliding_finger_its_home() -> None:
    limits = {"lower": -2.0, "upper": 2.0, "velocity": 2.0, "effort": 10.0}
    joints = tuple(RobotJoint(name=name, group="arm", home=0.2, **limits) for name in ("one", "three"))
    slide = RobotJoint(name="slider", group="hand", lower=0.0, upper=0.1, velocity=1.0, effort=1.0, home=0.05)
    robot = RobotModel(
        model=Folder(files={"robot.xml": COUPLED.encode()}),
        joints=(*joints, slide),
        links={"base": "arm", "one": "arm", "two": "arm", "three": "arm", "slider": "hand"},
        frames={"palm": "palm"},
        source="hand-made",
        followers=(Follower(name="two", group="arm", leader="one", ratio=-1.5, offset=0.1),),
    )
    arm = ArmKinematics(robot, "arm")
    assert arm.joints == ("one", "three")

    def truth(one: float, three: float) -> np.ndarray:
        turns = np.cumsum([one, -1.5 * one + 0.1, three])
        links = [0.3, 0.3, 0.15]
        x, z = (sum(link * way(turn) for link, turn in zip(links, turns, strict=True)) for way in (np.cos, np.sin))
        pose = factories.pose(x, 0.0, -z)
        c, s = np.cos(turns[-1]), np.sin(turns[-1])
        pose[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
        return pose

    assert np.allclose(arm.pose(np.array([0.3, -0.4])), truth(0.3, -0.4), atol=1e-9)
    found = arm.solve(truth(0.6, 0.5), restarts=4)
    assert found.reached()
    assert np.allclose(found.joints, [0.6, 0.5], atol=0.01)


def test_redundant_joints_that_settle_slowly_do_not_jump(robot: RobotModel) -> None:
    jumps = {}
    for settle in (np.inf, 0.08):
        control = PoseControl(robot, 20.0, settle)
        begun = np.array([joint.home for joint in robot.joints])
        left = control.arms(("left",))
        # The arm is away from its home, and the palm shall stay.
        arm = np.array([[joint.name for joint in robot.joints].index(name) for name in left.joints])
        begun[arm] += 0.1 * np.array([1, -1, 1, 1, -1, 1, -1])
        control.begin(begun)
        stay = Command({"left": Aim(left.pose(begun[arm]), np.zeros(len(robot.limbs["left"].hand)))}, "approach")
        first = np.abs(control.follow(stay)[arm] - begun[arm]).max()
        for _ in range(400):
            control.follow(stay)
        jumps[settle] = first
        assert control.lag_m(stay) < 0.002
    assert jumps[0.08] < 0.08 / 20 * 3
    assert jumps[0.08] < 0.3 * jumps[np.inf]
