"""The bound on a limb's reach: no configuration goes beyond it, and it is no longer than its lengths."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.sim.model import reach
from dextera_build.sim.model.robot import load
from tests import episodes, task_bundles
from tests.robots.robot_recipes import built


@pytest.fixture(scope="module", params=["arm", "gantry", "kuka_leap", "openarm_revo1"])
def robot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    by_hand = {"arm": episodes.robot, "gantry": task_bundles.robot}
    if request.param in by_hand:
        return by_hand[request.param]()
    return built(request.param, tmp_path_factory.mktemp(request.param))


@pytest.mark.medium
def test_no_configuration_is_beyond_it(robot: RobotModel) -> None:
    model = load(robot.model).compile()
    data = mujoco.MjData(model)
    random = np.random.default_rng(0)
    for limb, own in robot.limbs.items():
        bound = reach.of_limb(robot, limb)
        assert bound is not None
        frames = [robot.frames[role] for role in (own.palm, *own.tips) if role]
        for _ in range(100):
            drawn = {joint.name: random.uniform(joint.lower, joint.upper) for joint in robot.joints}
            for name, position in robot.followed(drawn).items():
                data.joint(name).qpos[0] = position
            mujoco.mj_kinematics(model, data)
            base = data.body("base")
            for frame in frames:
                place = base.xmat.reshape(3, 3).T @ (data.site(frame).xpos - base.xpos)
                assert np.linalg.norm(place - bound.centre_m) <= bound.radius_m + 1e-9


def test_a_straight_arm_reaches_the_sum_of_its_lengths() -> None:
    found = reach.of_limb(episodes.robot(), "arm")
    assert found is not None
    assert found.joint == "joint_1"
    assert found.centre_m == pytest.approx([0.0, 0.0, 0.1])
    # 0.15 m and 0.25 m between the joints, and the fingertips beside the axis, 0.2 m beyond the last.
    assert found.radius_m == pytest.approx(0.15 + 0.25 + np.hypot(0.2, 0.015))


def test_a_limb_without_joints_has_none() -> None:
    robot = episodes.robot()
    bare = robot.limbs["arm"].model_copy(update={"arm": (), "hand": ()})
    assert reach.of_limb(robot.model_copy(update={"limbs": {"arm": bare}}), "arm") is None
