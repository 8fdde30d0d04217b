"""Kinds of actions: each asks for the same joint targets, and none asks for what the robot cannot do."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import MachineError, RuleError
from dextera_build.policy import actions
from dextera_build.sim.control.action_map import ActionMap
from dextera_build.sim.training.gym import TaskEnv
from tests import episodes, task_bundles
from tests.robots.robot_recipes import built

KINDS = tuple(actions.ABOUT)


def reach(bundle: TaskBundle, steps: int = 20) -> np.ndarray:
    """Joint targets (T, A) from home towards a corner of the limits, within half of the speed limits."""
    joints = bundle.robot.joints
    home, speed = (np.array([getattr(joint, name) for joint in joints]) for name in ("home", "velocity"))
    middle = np.array([(joint.lower + joint.upper) / 2 for joint in joints])
    way = np.where(middle >= home, 1.0, -1.0) * np.minimum(0.5 * speed / bundle.task.control_hz, 0.0015)
    found: np.ndarray = home + np.arange(1, steps + 1)[:, None] * way
    return found


def turning() -> TaskBundle:
    """A task of an arm with three hinges, whose limits in the file are radians."""
    bundle = episodes.bundle()
    xml = bundle.robot.model.files["robot.xml"].replace(b"<worldbody>", b'<compiler angle="radian"/><worldbody>')
    robot = bundle.robot.model_copy(update={"model": Folder(files={"robot.xml": xml})})
    return bundle.model_copy(update={"robot": robot})


@pytest.mark.parametrize("make", [task_bundles.lift, turning])
@pytest.mark.parametrize("kind", KINDS)
def test_the_same_reach_is_sent_in_every_kind(make, kind):
    bundle = make()
    wanted = reach(bundle)
    environment = TaskEnv(bundle, action=kind)
    environment.reset(seed=0)
    for targets in wanted:
        action = environment.actions.actions(targets, environment.environment.previous_action)
        assert environment.action_space.contains(action.astype(np.float32))
        *_, info = environment.step(action)
        assert info["executed"] == pytest.approx(targets, abs=2e-4)


def test_names_and_limits_are_those_of_the_kind():
    robot, task = task_bundles.robot(), task_bundles.lift().task
    specs = {kind: actions.of_task(task, robot, kind) for kind in KINDS}
    assert specs["joint"].names == ("x", "y", "z", "left", "right")
    assert specs["delta"].names == ("x.delta", "y.delta", "z.delta", "left.delta", "right.delta")
    assert specs["delta"].upper == pytest.approx([joint.velocity / 20.0 for joint in robot.joints])
    assert specs["end_effector"].names == ("dx", "dy", "dz", "rx", "ry", "rz", "left", "right")
    assert specs["end_effector"].upper[:6] == pytest.approx([0.05] * 3 + [0.15] * 3)
    assert specs["end_effector"].upper[6:] == pytest.approx([0.06, 0.06])
    assert all(spec.rate_hz == 20.0 and len(spec.names) == len(spec.lower) for spec in specs.values())
    assert actions.of_task(task.model_copy(update={"action": "delta"}), robot).kind == "delta"


def test_an_action_beyond_its_limits_is_cut():
    robot, task = task_bundles.robot(), task_bundles.lift().task
    sent = np.array([joint.home for joint in robot.joints])
    step = actions.of_task(task, robot, "delta").upper
    assert ActionMap(task, robot, "delta").targets(np.full(5, 9.0), sent) == pytest.approx(sent + step)
    palm = ActionMap(task, robot, "end_effector")
    far, near = np.zeros(8), np.zeros(8)
    far[0], near[0] = 9.0, 0.05
    far[6:] = near[6:] = 0.05
    assert palm.targets(far, sent) == pytest.approx(palm.targets(near, sent))


@pytest.mark.medium
def test_a_palm_moves_along_the_axes_of_the_base_and_two_arms_move_apart(tmp_path):
    robot: RobotModel = built("openarm_revo1", tmp_path)
    made = ActionMap(task_bundles.lift().task, robot, "end_effector")
    assert made.spec.names[:2] == ("left.dx", "left.dy")
    assert made.spec.names[6] == "right.dx"
    sent = np.array([joint.home for joint in robot.joints])
    action = made.actions(sent, sent)
    assert action[:12] == pytest.approx(0.0)
    action[0], action[8] = 0.01, 0.01
    moved = made.actions(made.targets(action, sent), sent)
    assert moved[:12] == pytest.approx(action[:12], abs=1e-3)
    assert moved[12:] == pytest.approx(action[12:])


@pytest.mark.parametrize("kind", KINDS)
def test_a_broken_action_ends_the_episode_with_its_reason(kind):
    environment = TaskEnv(task_bundles.lift(), action=kind)
    environment.reset(seed=0)
    name = environment.actions.spec.names[0]
    action = np.zeros(environment.action_space.shape)
    action[0] = np.nan
    *_, terminated, _, info = environment.step(action)
    assert (terminated, info["reason"]) == (True, f"the action for `{name}` is not a finite number")
    environment.reset(seed=0)
    *_, terminated, _, info = environment.step(np.zeros(3))
    assert terminated
    assert info["reason"] == f"the action has shape (3,), but kind `{kind}` has {len(action)} numbers"


def test_kinds_that_do_not_exist_or_that_the_robot_lacks_are_refused():
    bundle = task_bundles.lift()
    with pytest.raises(RuleError, match="there is no kind of action `torque`") as caught:
        ActionMap(bundle.task, bundle.robot, "torque")
    assert caught.value.code == "DXB-B515"
    assert caught.value.facts == {"kinds": "delta, end_effector, joint"}
    limbs = {name: limb.model_copy(update={"palm": ""}) for name, limb in bundle.robot.limbs.items()}
    with pytest.raises(RuleError, match="move palms, but no limb of the robot has one") as caught:
        ActionMap(bundle.task, bundle.robot.model_copy(update={"limbs": limbs}), "end_effector")
    assert caught.value.code == "DXB-B515"
    assert caught.value.facts["limbs"] == "arm"
    assert caught.value.hint == "add a frame `palm` to the robot, or choose `joint` or `delta`"


@pytest.mark.parametrize("package", ["mink", "daqp"])
def test_without_a_solver_only_palms_are_refused(monkeypatch, package):
    monkeypatch.setitem(sys.modules, package, None)
    for kind in ("joint", "delta"):
        TaskEnv(task_bundles.lift(), action=kind)
    with pytest.raises(MachineError, match="need inverse kinematics, which is not installed") as caught:
        TaskEnv(task_bundles.lift(), action="end_effector")
    assert caught.value.code == "DXB-E430"
    assert caught.value.facts == {"missing": package}
    assert caught.value.hint.endswith("`joint` and `delta` need neither")
