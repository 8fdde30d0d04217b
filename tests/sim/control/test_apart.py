"""Arms that keep apart from the rest of their robot, against the collisions of the whole robot."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.sim.control.ik import ArmKinematics
from tests.robots import robot_recipes

APART_M = 0.005
STEP_S = 0.02


@pytest.fixture(scope="module", params=["kuka_leap", pytest.param("openarm_revo1", marks=pytest.mark.slow)])
def robot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return robot_recipes.built(request.param, tmp_path_factory.mktemp("robot"))


@pytest.fixture(scope="module")
def arm(robot: RobotModel) -> ArmKinematics:
    return ArmKinematics(robot, robot.limb_names, apart_m=APART_M)


@pytest.fixture(scope="module")
def careless(robot: RobotModel) -> ArmKinematics:
    return ArmKinematics(robot, robot.limb_names)


def inward(arm: ArmKinematics, seed: int) -> np.ndarray:
    """Palms (L, 4, 4) that are to go through the robot's base."""
    target = arm.poses(arm.home).copy()
    target[:, :3, 3] = np.random.default_rng(seed).normal([0.0, 0.0, 0.25], 0.15, (len(target), 3))
    return target


def followed(arm: ArmKinematics, target: np.ndarray, steps: int = 60) -> Iterator[np.ndarray]:
    """Joints (A,) of control steps from home towards a target."""
    joints = arm.home.copy()
    for _ in range(steps):
        joints = arm.track(target, joints, STEP_S)
        yield joints


def deepest_m(robot: RobotModel, arm: ArmKinematics, ways: Iterator[np.ndarray]) -> float:
    """How deep links but hands press into each other along a way [m]."""
    model = robot_recipes.compiled(robot)
    deepest = 0.0
    for joints in ways:
        state = robot.followed(robot.home | dict(zip(arm.joints, joints.tolist(), strict=True)))
        data = robot_recipes.at(model, state)
        for contact in data.contact[: data.ncon]:
            parts = {robot.links[model.body(model.geom_bodyid[geom]).name] for geom in contact.geom}
            deepest = max(deepest, -contact.dist if parts != {"hand"} else 0.0)
    return deepest


@pytest.mark.medium
@pytest.mark.parametrize("seed", [0, 1])
def test_arms_do_not_run_into_their_robot_where_others_do(
    robot: RobotModel, arm: ArmKinematics, careless: ArmKinematics, seed: int
) -> None:
    target, met = inward(arm, seed), set()

    def noted() -> Iterator[np.ndarray]:
        for joints in followed(arm, target):
            met.update(arm.met)
            yield joints

    assert deepest_m(robot, careless, followed(careless, target)) > 0.01
    assert deepest_m(robot, arm, noted()) == 0.0
    assert met
    assert careless.met == []
    assert {name for pair in met for name in pair} <= set(robot.links)


def test_a_way_through_free_space_is_the_same(arm: ArmKinematics, careless: ArmKinematics) -> None:
    target = arm.poses(arm.home).copy()
    target[:, :3, 3] += [0.05, 0.02, 0.05]
    for kept, plain in zip(followed(arm, target, 20), followed(careless, target, 20), strict=True):
        np.testing.assert_array_equal(kept, plain)
        assert arm.met == []


def test_an_arm_that_is_too_near_can_leave_again(
    robot: RobotModel, arm: ArmKinematics, careless: ArmKinematics
) -> None:
    joints = next(
        each for each in followed(careless, inward(arm, 0)) if deepest_m(robot, careless, iter([each])) > 0.001
    )
    away = arm.poses(arm.home)
    for _ in range(100):
        joints = arm.track(away, joints, STEP_S)
    np.testing.assert_allclose(arm.poses(joints)[:, :3, 3], away[:, :3, 3], atol=0.005)
