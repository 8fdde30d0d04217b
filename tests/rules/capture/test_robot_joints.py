"""Joint positions of capture folders against the robot's model and its recorded poses."""

from __future__ import annotations

import json
import re
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.image import png
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.errors import RuleError
from dextera_build.geometry import poses
from dextera_build.sim.model import forward
from dextera_build.testing import RuleRunner
from rules.capture.robot import moved
from tests.rules.capture.moving_robot import CAMERA, NAMES, POSTURES, picture, three_hinges
from tests.rules.simulate.robot_files import arm


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return three_hinges(tmp_path_factory.mktemp("robot"))


def poses_of(robot: RobotModel, joints: Joints) -> np.ndarray:
    """Poses of the flange, with a tool and a base elsewhere."""
    placed = forward.frames(robot, joints.names, joints.positions, "flange")
    return np.array([poses.from_matrix(each) for each in placed])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda rows: rows, ""),
        (lambda rows: rows[:, [0, 2, 1]], "`b` and `c` swapped"),
        (lambda rows: rows * [-1, 1, 1], "sign of `a` changed"),
    ],
)
def test_joints_that_do_not_give_the_recorded_poses_are_refused(robot, tmp_path, change, says):
    """Where limits tell nothing, poses do."""
    joints = Joints(names=NAMES, stamps=np.arange(6.0), positions=POSTURES)
    wrong = joints.model_copy(update={"positions": np.ascontiguousarray(change(POSTURES))})
    recorded = poses_of(robot, joints)

    class Refusing:
        def fail(self, message: str, **facts: Any) -> None:
            raise RuleError(message, code="DXB-B202", facts=facts)

    if not says:
        moved.check_poses(Refusing(), robot, wrong, recorded, "flange")
        return
    with pytest.raises(RuleError) as caught:
        moved.check_poses(Refusing(), robot, wrong, recorded, "flange")
    assert says in caught.value.message
    assert "deg in the median over 15 pairs" in caught.value.facts["turns"]


def folder_of(robot: RobotModel, positions: np.ndarray, names: tuple[str, ...] = NAMES, **pose: object) -> Folder:
    """A capture folder with joints, and the poses that the true postures give."""
    views = []
    for number, (row, place) in enumerate(zip(positions, poses_of(robot, states_at(POSTURES)), strict=True)):
        effector = {"t_m": place[:3].tolist(), "quat_wxyz": place[3:].tolist()}
        view = {
            "rgb": f"rgb_{number}.png",
            "T_base_ee": effector,
            "joints": dict(zip(names, row.tolist(), strict=True)),
        }
        views.append(view)
    facts = {**CAMERA.model_dump(), "setup": "eye-to-hand", "effector_frame": "flange", "views": views, **pose}
    random = np.random.default_rng(3)
    pictures = {f"rgb_{n}.png": png(picture(row, random)) for n, row in enumerate(POSTURES)}
    return Folder(files={"capture.json": json.dumps(facts).encode(), **pictures})


def states_at(positions: np.ndarray) -> Joints:
    return Joints(names=NAMES, stamps=np.arange(float(len(positions))), positions=positions)


@pytest.mark.parametrize(
    ("change", "names", "says"),
    [
        (lambda rows: rows, NAMES, ""),
        (lambda rows: rows[:, ::-1], NAMES[::-1], ""),
        (np.degrees, NAMES, "they fit as degrees"),
        (lambda rows: rows[:, [1, 0, 2]], NAMES, "another order"),
        (lambda rows: rows * [1, 1, -1], NAMES, "not those of this robot"),
        (lambda rows: rows * [-1, 1, 1], NAMES, "sign of `a` changed"),
        (lambda rows: rows, ("a", "b", "d"), "lack 1 joints of the robot, `c` first"),
    ],
)
def test_joints_of_a_folder_are_checked_against_the_robot(robot, tmp_path, change, names, says):
    runner, folder = RuleRunner(tmp_path), folder_of(robot, change(POSTURES), names)
    if not says:
        found = runner.run("capture.robot_views", folder=folder, robot=robot)
        assert found.joints.names == NAMES
        np.testing.assert_allclose(found.joints.positions, POSTURES)
        return
    with pytest.raises(RuleError, match=re.escape(says)):
        runner.run("capture.robot_views", folder=folder, robot=robot)


def test_states_of_another_moment_do_not_give_the_poses(robot, tmp_path):
    """Joints and poses of a folder that were not read at the same time."""
    with pytest.raises(RuleError, match="do not give the recorded poses"):
        RuleRunner(tmp_path).run(
            "capture.robot_views", folder=folder_of(robot, np.roll(POSTURES, 1, axis=0)), robot=robot
        )


def test_millimetres_of_a_sliding_joint_are_refused(tmp_path):
    parts = [{"file": "arm_description/urdf/arm.urdf"}]
    model = RuleRunner(tmp_path / "robot").run("simulate.imported_robot", files=arm(), options={"parts": parts})
    names = tuple(joint.name for joint in model.joints)
    rows = np.array([[0.1, 0.2, 0.01], [0.4, 0.9, 0.02], [-0.5, 1.2, 0.035]]) * [1, 1, 1000]
    views = [
        {"rgb": f"rgb_{n}.png", "joints": dict(zip(names, row.tolist(), strict=True))} for n, row in enumerate(rows)
    ]
    facts = {**CAMERA.model_dump(), "setup": "eye-to-hand", "views": views}
    pictures = {f"rgb_{n}.png": png(picture(POSTURES[n], np.random.default_rng(0))) for n in range(3)}
    folder = Folder(files={"capture.json": json.dumps(facts).encode(), **pictures})
    with pytest.raises(RuleError, match="grip would fit as millimetres"):
        RuleRunner(tmp_path).run("capture.robot_views", folder=folder, robot=model)
