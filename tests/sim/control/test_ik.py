"""Inverse kinematics of the palm, against the robot's own forward kinematics."""

from __future__ import annotations

import mink
import numpy as np
import pytest

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import transforms
from dextera_build.sim.control import ik
from dextera_build.sim.control.ik import ArmKinematics
from tests.robots import robot_recipes


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return robot_recipes.built("kuka_leap", tmp_path_factory.mktemp("robot"))


@pytest.fixture(scope="module")
def arm(robot: RobotModel) -> ArmKinematics:
    return ArmKinematics(robot, "arm")


def drawn(arm: ArmKinematics, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    return np.clip(arm.home + random.normal(0, 0.5, len(arm.home)), arm.lower + 0.05, arm.upper - 0.05)


@pytest.mark.medium
def test_forward_kinematics_are_those_of_the_whole_robot(robot: RobotModel, arm: ArmKinematics) -> None:
    """Also with the fingers bent, which the arm's own model does not have."""
    joints = drawn(arm, 1)
    data = robot_recipes.at(robot_recipes.compiled(robot), robot.home | dict(zip(arm.joints, joints, strict=True)))
    site = data.site(robot.frames["palm"])
    assert np.allclose(arm.pose(joints)[:3, 3], site.xpos, atol=1e-5)
    assert np.allclose(arm.pose(joints)[:3, :3], site.xmat.reshape(3, 3), atol=1e-5)


@pytest.mark.parametrize("seed", range(20))
def test_a_pose_that_the_arm_has_is_reached_within_its_limits(arm: ArmKinematics, seed: int) -> None:
    target = arm.pose(drawn(arm, seed))
    found = arm.solve(target)
    assert found.reached()
    assert np.allclose(arm.pose(found.joints), target, atol=0.01)
    assert (found.joints >= arm.lower).all()
    assert (found.joints <= arm.upper).all()
    assert found.margin_rad == pytest.approx(np.minimum(found.joints - arm.lower, arm.upper - found.joints).min())


@pytest.mark.parametrize("dt", [0.01, np.inf])
def test_a_step_is_that_of_mink(arm: ArmKinematics, dt: float) -> None:
    """Its own solution of the same problem is for speed alone."""
    arm._state.update(arm._spread(drawn(arm, 3)))
    arm._aim(arm.pose(drawn(arm, 4)))
    arm._state.update(arm._spread(drawn(arm, 3)))
    arm._posture.set_target(arm._spread(arm.home))
    limits = (arm._range, arm._speed) if np.isfinite(dt) else (arm._range,)
    seconds = dt if np.isfinite(dt) else 1.0
    velocity = mink.solve_ik(
        arm._state, [*arm._palms, arm._posture], seconds, solver=ik.SOLVER, damping=ik.DAMPING, limits=limits
    )
    assert np.allclose(arm._displacement(dt), velocity * seconds, atol=1e-6)


def test_a_goal_out_of_reach_says_how_far_it_is(arm: ArmKinematics) -> None:
    target = arm.pose(arm.home)
    target[0, 3] += 2.0
    found = arm.solve(target)
    assert not found.reached()
    assert found.position_error_m > 1.0


def test_solutions_do_not_depend_on_what_was_solved_before(arm: ArmKinematics) -> None:
    target = arm.pose(drawn(arm, 5))
    first = arm.solve(target).joints
    arm.solve(arm.pose(drawn(arm, 6)))
    assert np.array_equal(arm.solve(target).joints, first)


def test_tracking_keeps_the_speed_limits_and_arrives(robot: RobotModel, arm: ArmKinematics) -> None:
    speeds = np.array([joint.velocity for joint in robot.joints if joint.group == "arm"])
    joints, target = arm.home.copy(), arm.pose(drawn(arm, 3))
    for _ in range(200):
        moved = arm.track(target, joints, 0.05)
        assert (np.abs(moved - joints) <= speeds * 0.05 + 1e-6).all()
        joints = moved
    left = transforms.invert(arm.pose(joints)) @ target
    assert np.linalg.norm(left[:3, 3]) < 0.002
    assert transforms.angle(left[:3, :3]) < 0.01
