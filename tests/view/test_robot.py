"""A robot in the viewer: sliders end at the limits, frames and followers move with the joints."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import quaternions
from dextera_build.sim.model.robot import load
from dextera_build.view import panel, save, server
from dextera_build.view.robot import BEHIND, POSTURES, RobotView
from tests.rules.simulate.robot_files import arm
from tests.rules.simulate.test_imported_robot import URDF, made
from tests.teleop.chromium import Screen, chromium
from tests.view.test_view import Recorder

FIELD = "document.querySelector('#dxb input[type=range]')"
MOVED = """{{ const rows = [...document.querySelectorAll('#dxb label')];
  const row = rows.find((e) => e.textContent.startsWith('{name} ['));
  const bar = row.querySelector('input'); bar.value = {value}; bar.dispatchEvent(new Event('input')); }} 0"""
POSE = """(() => {{ const pose = window.__viserMutable.nodePoseData['{name}'];
  return [[...pose.position], [...pose.wxyz]]; }})()"""


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


def test_the_background_is_grey_and_a_saved_page_has_the_sliders(view: tuple[Recorder, RobotView]) -> None:
    recorder, _ = view
    assert (recorder.background == BEHIND).all()
    (control,) = [each for each in panel.noted(recorder) if each["kind"] == "robot"]
    told = {each["name"]: (each["low"], each["high"], each["home"]) for each in control["joints"]}
    assert told["grip"] == (0.0, 0.04, 0.01)
    assert {"/robot/upper", "/robot/roles/palm", "/robot/labels/palm"} <= {each["name"] for each in control["nodes"]}
    assert {each["name"] for each in control["nodes"]} <= recorder.nodes.keys()


@pytest.mark.slow
def test_sliders_of_a_saved_page_move_the_robot_as_mujoco_does(robot: RobotModel, tmp_path: Path) -> None:
    running, _ = server.start(port=18380)
    try:
        view = RobotView(running, "/robot", robot)
        page = save.write(running, tmp_path / "robot.html", view.sweep())
    finally:
        server.stop(running)
    wanted = {"shoulder": 0.7, "elbow": 1.1, "grip": 0.03}

    async def use() -> dict[str, Any]:
        async with chromium(tmp_path, Screen(900, 700)) as browser:
            await browser.go(page.as_uri())
            await browser.until("!!(window.__viserMutable?.nodeRefFromName['/robot/upper'] && " + FIELD + ")", 120)
            for name, value in wanted.items():
                await browser.run(MOVED.format(name=name, value=value))
            await browser.until("!window.__viserMutable.messageQueue.length", 30)
            await browser.picture(tmp_path / "robot.png")
            names = ["/robot/upper", *(f"/robot/roles/{role}" for role in robot.frames)]
            found = {name: await browser.run(POSE.format(name=name)) for name in names}
            return {"poses": found, "moves": await browser.run("window.dxbMoves"), "faults": browser.faults}

    found = asyncio.run(use())
    assert (found["faults"], found["moves"]) == ([], False)
    state = at(robot, wanted)
    for name, (position, quaternion) in found["poses"].items():
        role = name.rpartition("/")[2]
        body = state.body("upper") if role == "upper" else state.site(robot.frames[role])
        # A slider of the page has 500 steps.
        np.testing.assert_allclose(position, body.xpos, atol=5e-3)
        np.testing.assert_allclose(quaternions.to_matrix(np.array(quaternion)), body.xmat.reshape(3, 3), atol=1e-2)


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
