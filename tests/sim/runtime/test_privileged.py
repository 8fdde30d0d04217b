"""Privileged readings against differences of poses."""

from __future__ import annotations

import mujoco
import numpy as np

from dextera_build.geometry import lie, transforms
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.privileged import Simulated, privileged, values
from tests import task_bundles


def spinning() -> Environment:
    """The box turned, moving and turning fast; nothing touches it."""
    environment = Environment(task_bundles.lift())
    joint = environment.data.joint("box")
    joint.qpos[:] = 0.1, 0.5, 0.4, 0.5, 0.5, -0.5, 0.5
    joint.qvel[:] = 0.3, -0.2, 0.1, 1.0, 2.0, -3.0
    mujoco.mj_forward(environment.model, environment.data)
    return environment


def test_velocities_are_those_of_the_origin_in_the_base_frame():
    """Compared with differences of poses, which know no conventions."""
    environment = spinning()
    found = privileged(Simulated([environment]))["object_velocities"][0]
    step = 1e-6
    before = environment.object_poses()[0]
    environment.model.opt.gravity[:] = 0
    mujoco.mj_integratePos(environment.model, environment.data.qpos, environment.data.qvel, step)
    mujoco.mj_kinematics(environment.model, environment.data)
    after = environment.object_poses()[0]
    assert np.allclose(found[:3], (after[:3] - before[:3]) / step, atol=1e-3)
    back = before[3:] * [1, -1, -1, -1]
    turn, angular = np.zeros(4), np.zeros(3)
    mujoco.mju_mulQuat(turn, after[3:], back)
    mujoco.mju_quat2Vel(angular, turn / np.linalg.norm(turn), step)
    assert np.allclose(found[3:], angular, atol=1e-2)
    assert not np.allclose(found[3:], environment.data.joint("box").qvel[3:], atol=0.1)


def test_an_off_centre_mass_does_not_shift_the_velocity_of_the_origin():
    environment = spinning()
    wanted = privileged(Simulated([environment]))["object_velocities"][0].copy()
    environment.model.body_ipos[environment.model.body("box").id] = 0.01, -0.02, 0.015
    mujoco.mj_forward(environment.model, environment.data)
    assert np.allclose(privileged(Simulated([environment]))["object_velocities"][0], wanted, atol=1e-6)


def test_tips_stand_and_move_with_the_joints():
    environment = Environment(task_bundles.lift())
    worlds = Simulated([environment])
    environment.data.qvel[environment.model.joint("robot/y").dofadr[0]] = 0.25
    environment.data.qvel[environment.model.joint("robot/left").dofadr[0]] = 0.5
    mujoco.mj_forward(environment.model, environment.data)
    seen = privileged(worlds)
    assert np.allclose(seen["joint_velocities"], [0, 0.25, 0, 0.5, 0])
    assert np.allclose(seen["tip_velocities"], [[0, 0.75, 0, 0, 0, 0], [0, 0.25, 0, 0, 0, 0]], atol=1e-6)
    assert np.allclose(seen["tip_poses"][:, :3], [[0, 0.055, 0.01], [0, -0.055, 0.01]], atol=1e-6)
    assert np.allclose(seen["hand_poses"][0, :3], [0, 0, 0.12], atol=1e-6)


def test_points_lie_on_the_object_wherever_it_is():
    environment = spinning()
    points = privileged(Simulated([environment]))["points"]
    pose = environment.object_poses()[0]
    assert np.allclose(np.linalg.norm(points - pose[:3], axis=1), np.sqrt(3) * task_bundles.HALF_M, atol=1e-6)
    assert np.allclose(points.mean(axis=0), pose[:3], atol=1e-6)


def test_several_worlds_give_what_each_gives_alone():
    worlds = [spinning(), Environment(task_bundles.lift())]
    together = values(Simulated(worlds))
    for number, world in enumerate(worlds):
        alone = values(Simulated([world]))
        assert {name: each[number].tobytes() for name, each in together.items()} == {
            name: each[0].tobytes() for name, each in alone.items()
        }
    assert not np.array_equal(*together["object_velocities"])


def test_all_is_in_the_base_where_it_truly_is():
    environment = Environment(task_bundles.lift())
    before = privileged(Simulated([environment]))
    worlds, told = Simulated([environment]), environment.object_poses()[0]
    error = (0.02, -0.01, 0.03, 0.05, -0.02, 0.1)
    environment.begin(environment.start.model_copy(update={"base_error": error}))
    environment.data.joint("box").qvel[:] = 0.3, -0.2, 0.1, 1.0, 2.0, -3.0
    mujoco.mj_forward(environment.model, environment.data)
    after = privileged(worlds)
    assert np.allclose(after["tip_poses"], before["tip_poses"], atol=1e-6)
    assert np.allclose(after["hand_poses"], before["hand_poses"], atol=1e-6)
    base = lie.retract(environment.bundle.base_pose.matrix, error)
    box = environment.data.body("box")
    assert np.allclose(after["points"].mean(axis=0), transforms.apply(transforms.invert(base), box.xpos), atol=1e-6)
    assert np.linalg.norm(after["points"].mean(axis=0) - told[:3]) > 0.01
    assert np.allclose(after["object_velocities"][0, :3], base[:3, :3].T @ [0.3, -0.2, 0.1], atol=1e-6)
