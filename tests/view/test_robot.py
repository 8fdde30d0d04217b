"""A robot in the viewer: sliders end at the limits, frames and followers move with the joints."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import quaternions
from dextera_build.sim.model.robot import load
from dextera_build.view.robot import POSTURES, RobotView
from tests.rules.simulate.robot_files import arm
from tests.rules.simulate.test_imported_robot import URDF, made
from tests.view.test_view import Recorder


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    frames = {
        "palm": {"link": "tool0", "at_m": (0, 0, 0.05)},
        "tip_left": {"link": "left"},
        "tip_right": {"link": "right"},
    }
    limbs = {"arm": {"gripper": {"joint": "grip", "open": 0.04}}}
    files = {"parts": [{"file": URDF}], "hand": ["left", "right"], "home_rad": {"grip": 0.01}}
    return made(tmp_path_factory.mktemp("robot"), arm(), **files, frames=frames, limbs=limbs)


@pytest.fixture
def view(robot: RobotModel) -> tuple[Recorder, RobotView]:
    recorder = Recorder()
    return recorder, RobotView(recorder, "/robot", robot)


def at(robot: RobotModel, joints: dict[str, float]) -> mujoco.MjData:
    """The state with these joints, and others at home."""
    model = load(robot.model).compile()
    data = mujoco.MjData(model)
    for name, position in robot.followed({**robot.home, **joints}).items():
        data.joint(name).qpos[0] = position
    mujoco.mj_kinematics(model, data)
    return data


def test_sliders_begin_at_home_and_end_at_the_limits(view: tuple[Recorder, RobotView]) -> None:
    recorder, _ = view
    slider, grip = recorder.controls["shoulder [deg]"], recorder.controls["grip [mm]"]
    assert (np.radians(slider.min), np.radians(slider.max)) == pytest.approx((-2.1, 1.9), abs=2e-3)
    assert np.radians(slider.min) >= -2.1
    assert np.radians(slider.max) <= 1.9
    assert (grip.min, grip.max, grip.value) == (0.0, 40.0, 10.0)


def test_frames_and_followers_move_with_a_slider(view: tuple[Recorder, RobotView], robot: RobotModel) -> None:
    recorder, _ = view
    slider = recorder.controls["grip [mm]"]
    slider.value = 30.0
    slider.moved(None)
    elbow = recorder.controls["elbow [deg]"]
    elbow.value = 40.0
    elbow.moved(None)
    wanted = at(robot, {"grip": 0.03, "elbow": np.radians(40.0)})
    for role in ("palm", "tip_left", "tip_right"):
        frame, site = recorder.nodes[f"/robot/roles/{role}"], wanted.site(robot.frames[role])
        np.testing.assert_allclose(frame.position, site.xpos, atol=1e-9)
        np.testing.assert_allclose(quaternions.to_matrix(np.array(frame.wxyz)), site.xmat.reshape(3, 3), atol=1e-9)
    np.testing.assert_allclose(recorder.nodes["/robot/upper"].position, wanted.body("upper").xpos, atol=1e-6)


def test_roles_have_colours_and_collision_and_reach_are_hidden(view: tuple[Recorder, RobotView]) -> None:
    recorder, shown = view
    colours = {role: recorder.nodes[f"/robot/roles/{role}"].origin_color for role in ("palm", "tip_left", "tip_right")}
    assert colours["palm"] != colours["tip_left"] == colours["tip_right"]
    reach = recorder.nodes["/robot/reach/arm"]
    assert len(reach.values[0]) == POSTURES
    assert not reach.visible
    assert shown.figure.pieces
    assert not any(each.visible for each in shown.figure.pieces)
    for title, handles in (("Collision pieces", shown.figure.pieces), ("Reach of the palm", [reach])):
        box = recorder.controls[title]
        box.value = True
        box.moved(None)
        assert all(each.visible for each in handles)


def test_a_recording_takes_every_joint_to_its_limits_and_back(
    view: tuple[Recorder, RobotView], robot: RobotModel, tmp_path: Path
) -> None:
    recorder, shown = view
    palm = recorder.nodes["/robot/roles/palm"]
    places = [np.array(palm.position) for _ in shown.sweep()]
    ends = [at(robot, {"shoulder": limit}).site("palm").xpos for limit in (-2.1, 1.9)]
    for end in ends:
        assert min(float(np.linalg.norm(place - end)) for place in places) < 1e-9
    np.testing.assert_allclose(places[-1], at(robot, {}).site("palm").xpos, atol=1e-9)
