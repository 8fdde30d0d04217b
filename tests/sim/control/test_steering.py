"""Decisions of reinforced policies as joint targets."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.robots.robot import Follower, Grip, RobotModel
from dextera_build.artifacts.tasks.policy import Channel, PolicyContract
from dextera_build.geometry import lie
from dextera_build.sim.control.steering import CLOSING, Steering, _Palm
from dextera_build.sim.runtime.environment import Environment
from tests import task_bundles

HOME = np.array(list(task_bundles.HOME_M.values()))


SHUT = Grip(against="thumb", open={"left": 0.05, "right": 0.05}, closed={"left": 0.01, "right": 0.01})


def steering(**settings: Any) -> Steering:
    chosen = {
        "control": "palm",
        "joints": "",
        "every": 4,
        "step_m": 0.05,
        "step_rad": 0.2,
        "lead_rad": 0.3,
        **settings,
    }
    robot = task_bundles.robot()
    (limb,) = robot.limbs.values()
    robot = robot.model_copy(update={"limbs": {"arm": limb.model_copy(update={"grips": {"shut": SHUT}})}})
    names = tuple(joint.name for joint in robot.joints)
    contract = PolicyContract(
        algorithm="ppo",
        task="LiftBox",
        embodiment="0" * 64,
        inputs=(Channel(name="joints", shape=(5,), names=names),),
        action=Channel(name="action", shape=(5,), names=names, mean=tuple(HOME)),
        rate_hz=20.0,
        dataset="0" * 64,
        settings=chosen,
    )
    return Steering(robot, contract)


def test_the_palm_goes_where_it_is_steered_along_the_axes_of_the_base():
    environment = Environment(task_bundles.lift())
    steer = steering()
    assert steer.size == 3
    before = environment.palm_poses()[0]
    for decision in ([1, 0, 0], [0, -0.5, 0], [0, 0, 1]):
        for target in steer.targets(np.array(decision), environment.previous_action, environment.measure().joints):
            environment.step(target)
    for _ in range(10):
        environment.step(environment.previous_action)
    moved = environment.palm_poses()[0] - before
    assert moved[:3] == pytest.approx([0.05, -0.025, 0.05], abs=0.006)
    assert np.allclose(moved[3:], 0, atol=1e-3)


def test_fingertips_are_where_coupled_joints_carry_them():
    """One finger follows the other, as in hands with fewer motors than joints."""
    plain = task_bundles.robot()
    names = tuple(joint.name for joint in plain.joints)
    follower = Follower(name="right", group="hand", leader="left", ratio=-1.0)
    fields = {name: getattr(plain, name) for name in ("model", "links", "frames", "source")}
    coupled = RobotModel(joints=plain.joints[:4], followers=(follower,), **fields)
    joints = HOME + np.array([0.0, 0.0, 0.0, 0.01, -0.01])
    palms = [_Palm(plain, "arm", names, HOME, np.zeros(0)), _Palm(coupled, "arm", names[:4], HOME[:4], np.zeros(0))]
    both, led = palms[0].places(joints) - palms[0].places(HOME), palms[1].places(joints[:4]) - palms[1].places(HOME[:4])
    assert np.abs(both[3:]).max() > 0.01
    assert led == pytest.approx(both, abs=1e-6)


def test_a_step_beyond_the_range_of_a_joint_ends_at_its_limit():
    steer = steering(lead_rad=1.0)
    limit = task_bundles.robot().joints[0].upper
    sent = HOME.copy()
    sent[0] = limit - 0.01
    found = steer.targets(np.array([1.0, 0.5, 0.0]), sent, sent)[-1]
    assert limit - 0.003 < found[0] <= limit
    assert found[1] == pytest.approx(HOME[1] + 0.025, abs=0.001)


def test_targets_go_evenly_and_what_is_not_steered_stays_at_home():
    sent = HOME + np.array([0.1, 0.1, 0.1, 0.0, -0.02])
    found = steering().targets(np.array([1.0, 0, 0]), sent, sent)
    assert found.shape == (4, 5)
    assert np.allclose(np.diff(found[:, :3], axis=0), (found[0] - sent)[:3])
    assert np.array_equal(found[:, 3:], np.tile(HOME[3:], (4, 1)))


@pytest.mark.parametrize("control", ["palm", "joints"])
def test_decisions_beyond_one_count_as_one(control):
    steer = steering(control=control, joints="x y z left" if control == "joints" else "left")
    wild = np.array([50.0, -3.0, 1.0, 9.0])
    assert np.array_equal(steer.targets(wild, HOME, HOME), steer.targets(np.clip(wild, -1, 1), HOME, HOME))


def test_joints_are_steered_by_name():
    steer = steering(control="joints", joints="left z", step_rad=0.01)
    found = steer.targets(np.array([1.0, -1.0]), HOME, HOME)[-1]
    assert np.allclose(found - HOME, [0, 0, -0.01, 0.01, 0])


def test_targets_do_not_run_away_from_joints_that_are_held():
    steer = steering(control="joints", joints="x", lead_rad=0.05)
    held, sent = HOME.copy(), HOME.copy()
    for _ in range(10):
        sent = steer.targets(np.array([1.0]), sent, held)[-1]
    assert sent[0] == pytest.approx(0.05)


def test_nothing_is_remembered():
    steer = steering()
    decision, sent = np.array([0.3, -0.7, 0.2]), HOME + 0.01
    first = steer.targets(decision, sent, HOME)
    steer.targets(np.ones(3), HOME + 0.2, HOME)
    assert steer.targets(decision, sent, HOME).tobytes() == first.tobytes()


def test_the_network_is_told_where_palm_and_tips_are():
    sent = HOME + np.array([0.2, -0.1, 0.05, 0.01, 0.0])
    told = steering().numbers({"joints": sent[None, None].astype(np.float32)})
    assert told.dtype == np.float32
    assert told[0, :5] == pytest.approx(sent)
    assert told[0, 5:] == pytest.approx(np.array([0.2, -0.1, 0.05, 0.2, -0.095, 0.05]) / 0.2, abs=1e-6)


def test_the_palm_turns_to_where_the_contract_says():
    turn = np.array([0.92, 0.0, 0.0, 0.39]) / np.linalg.norm([0.92, 0.39])
    goal = steering(**{f"palm_{part}": float(value) for part, value in zip("wxyz", turn, strict=True)})
    # A gantry cannot turn; what it can do, it does not give up for that.
    found = goal.targets(np.array([1.0, 0, 0]), HOME, HOME)[-1]
    assert found[0] == pytest.approx(0.05, abs=0.005)


def test_one_decision_closes_and_opens_all_fingers_of_a_hand():
    steer = steering(grip="shut", joints="")
    assert steer.size == 4
    sent, met = HOME.copy(), []
    for closing in (1.0, 1.0, 1.0, -0.5, -1.0, -1.0):
        sent = steer.targets(np.array([0.0, 0.0, 0.0, closing]), sent, sent)[-1]
        met.append(sent[3:].copy())
    shares = np.array([CLOSING, 1.0, 1.0, 1.0 - CLOSING / 2, 0.5 - CLOSING / 2, 0.0])
    assert np.allclose(met, 0.05 - 0.04 * shares[:, None], atol=1e-9)


def test_fingers_that_an_object_stops_do_not_close_on():
    steer = steering(grip="shut", lead_rad=0.005)
    sent, held = HOME.copy(), HOME.copy()
    for _ in range(5):
        sent = steer.targets(np.array([0.0, 0.0, 0.0, 1.0]), sent, held)[-1]
    assert np.allclose(held[3:] - sent[3:], 0.005)


def test_a_palm_that_may_turn_is_asked_for_more_than_it_can_do_by_a_gantry():
    """Three more decisions turn the palm about the axes of the base; without any, it stays as it is."""
    steer = steering(turn_rad=0.2, grip="shut")
    assert steer.size == 7
    found = steer.targets(np.array([1.0, 0, 0, 0, 0, 0, 1.0]), HOME, HOME)[-1]
    assert found[:3] == pytest.approx([0.05, 0, 0], abs=0.002)
    (palm,) = steer._palms
    asked = []
    palm._kinematics.step = lambda target, joints, posture: asked.append(target) or joints
    steer.targets(np.array([0.0, 0, 0, 0.5, -1.0, 0, 0]), HOME, HOME)
    start = palm._kinematics.pose(HOME[palm.arm])
    assert np.allclose(asked[0][:3, :3], lie.rotation(np.array([0.1, -0.2, 0.0])) @ start[:3, :3], atol=1e-9)
    assert np.allclose(asked[0][:3, 3], start[:3, 3])
