"""Pinocchio reads the URDF of robots and objects, and finds what MuJoCo's model has."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.objects.object import Inertial, Joint
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import kinematics, transforms
from dextera_build.sim.model import links, urdf
from dextera_build.testing import RuleRunner
from tests import factories, readers
from tests.robots import robot_recipes

pytestmark = pytest.mark.slow

SCRIPT = Path(__file__).parent / "pinocchio_reader.py"
ROBOTS = ("kuka_leap", "openarm_revo1", "openarm_revo2")
STATES = 5
State: TypeAlias = Mapping[str, float]
"""Joint -> position [rad or m]."""


def read(written: Folder, states: Sequence[State], scratch: Path) -> dict[str, np.ndarray]:
    """What Pinocchio finds in a URDF, and in the states of its joints [rad or m]."""
    (file,) = (path for path in written.export(scratch, "urdf") if path.suffix == ".urdf")
    (scratch / "states.json").write_text(json.dumps(states))
    readers.run("geometry", SCRIPT, file, scratch / "states.json", scratch / "found.npz")
    return dict(np.load(scratch / "found.npz"))


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return robot_recipes.built(request.param, tmp_path_factory.mktemp(request.param))


def test_a_robot_moves_as_in_mujoco(robot: RobotModel, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    states = [{joint.name: rng.uniform(joint.lower, joint.upper) for joint in robot.joints} for _ in range(STATES)]
    found, model = read(urdf.write(robot), states, tmp_path), robot_recipes.compiled(robot)
    joints = {joint.name: joint for joint in robot.joints}
    assert sorted(found["joints"]) == sorted(joints)
    assert sorted(found["every_joint"]) == sorted(model.joint(number).name for number in range(model.njnt))
    for name in ("lower", "upper", "effort", "velocity"):
        np.testing.assert_allclose(found[name], [getattr(joints[joint], name) for joint in found["joints"]])
    check_motion(robot, found, states, model)
    assert found["collision"] > 0
    assert found["visual"] > 0


def check_motion(robot: RobotModel, found: Mapping[str, np.ndarray], states: Sequence[State], model: Any) -> None:
    """Poses of all links, and the mass matrix of the motors, are those of MuJoCo."""
    tree, order = links.tree(model, urdf.BASE), found["links"].tolist()
    follows = reduction(robot, model, found["joints"].tolist())
    for state, poses, matrix in zip(states, found["poses"], found["matrices"], strict=True):
        followed = {each.name: each.ratio * state[each.leader] + each.offset for each in robot.followers}
        data = robot_recipes.at(model, state | followed)
        for body, shift in tree.shifts.items():
            wanted = transforms.invert(place(data, urdf.BASE)) @ place(data, body)
            wanted[:3, 3] = transforms.apply(wanted, shift)
            np.testing.assert_allclose(poses[order.index(body)], wanted, atol=1e-9)
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        full -= np.diag(model.dof_armature)  # URDF has none
        np.testing.assert_allclose(matrix, follows.T @ full @ follows, rtol=1e-6, atol=1e-6)


def reduction(robot: RobotModel, model: Any, motors: Sequence[str]) -> np.ndarray:
    """Velocities of all joints per velocity of a motor (nv, M)."""
    found = np.zeros((model.nv, len(motors)))
    for column, name in enumerate(motors):
        found[model.joint(name).dofadr[0], column] = 1.0
    for each in robot.followers:
        found[model.joint(each.name).dofadr[0], motors.index(each.leader)] = each.ratio
    return found


def place(data: mujoco.MjData, body: str) -> np.ndarray:
    return transforms.rigid(data.body(body).xmat.reshape(3, 3), data.body(body).xpos)


def test_an_object_has_the_masses_joints_and_pieces_of_its_asset(tmp_path: Path) -> None:
    asset = factories.laptop_asset()
    written = RuleRunner(tmp_path / "run").run("simulate.urdf", asset=asset)
    states = [{"hinge": position} for position in (0.0, 1.0, 2.3)]
    found = read(written, states, tmp_path)
    (joint,) = asset.body.joints
    assert found["joints"].tolist() == [joint.name]
    assert found["lower"].tolist() == [joint.lower]
    assert found["upper"].tolist() == [joint.upper]
    order = found["links"].tolist()
    assert sorted(order) == sorted(asset.body.links)
    parts = asset.physics.links
    assert found["moving_kg"] == pytest.approx(parts[joint.child].mass_kg, rel=1e-9)
    assert found["fixed_kg"] == pytest.approx(parts[joint.parent].mass_kg, rel=1e-9)
    origins = {joint.child: np.array(joint.origin)}
    for state, poses, matrix in zip(states, found["poses"], found["matrices"], strict=True):
        for link, pose in kinematics.link_poses(asset.body, state).items():
            wanted = pose.copy()
            wanted[:3, 3] = transforms.apply(pose, origins.get(link, np.zeros(3)))
            np.testing.assert_allclose(poses[order.index(link)], wanted, atol=1e-9)
        assert matrix[0, 0] == pytest.approx(about(parts[joint.child], joint), rel=1e-6)
    assert found["collision"] == sum(len(pieces.hulls) for pieces in asset.collision.links.values())
    assert found["visual"] == len(asset.body.links)


def about(part: Inertial, joint: Joint) -> float:
    """Moment of inertia about the axis of a hinge, by Steiner's theorem [kg m^2]."""
    xx, yy, zz, xy, xz, yz = part.inertia
    axis, arm = np.array(joint.axis), np.array(part.centre) - np.array(joint.origin)
    own = axis @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ axis
    return float(own + part.mass_kg * np.sum(np.cross(axis, arm) ** 2))
