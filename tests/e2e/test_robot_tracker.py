"""`dxb run --cell`: a policy on poses that nobody publishes but the tracker, on the pictures of a robot over DDS."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.formats.ros import reading
from dextera_build.policy import robot_run
from tests import documents, gate
from tests.e2e.robots import DOMAIN, STORED, built, ended, started, stored
from tests.e2e.space import Space
from tests.sim.runtime import cells

pytest.importorskip("cyclonedds", reason="needs cyclonedds (extra `ros`)")

NAMES = ("--domain", DOMAIN)
RECIPE = """
summary: A task, a policy for it, and the camera that sees it.
inputs:
  stored: data/gate.json
  watched: data/cell.json
nodes:
  task: {rule: demo.task, stored: $stored, lift: {height_m: 0.1}}
  cell: {rule: demo.cell, stored: $watched}
  policy: {rule: learn.line, bundle: $task}
targets:
  default: [policy, cell]
"""
POLICY = '''
"""Runs policies of learn.line."""
import numpy as np

def predict(checkpoint, bundle):
    """Joint targets [rad]: on the way until the flap, whose pose the inputs hold, is there."""
    def act(inputs, step):
        assert np.isfinite(inputs["objects"]).all()
        return np.array([[TARGET]])
    return act
'''
ROBOT = """
<mujoco>
  <worldbody>
    <body name="base">
      <geom type="box" size="0.02 0.02 0.15" pos="0 0 0.15"/>
      <body name="link" pos="0 0 0.25">
        <joint name="turn" axis="0 0 1" range="-1.5 1.5"/>
        <geom type="capsule" size="0.012" fromto="0 0 0 0.15 0 0"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
"""What viewers of a recording draw of the arm."""
CELL = ("--cell", "task/gate:cell")


def task() -> TaskBundle:
    """The gate with long control periods, because the machine of a test is busy."""
    made = gate.bundle()
    robot = made.robot.model_copy(update={"model": Folder(files={"robot.xml": ROBOT.encode()})})
    slow = made.task.model_copy(update={"control_hz": 5.0})
    return made.model_copy(update={"task": slow, "robot": robot})


def project(space: Space) -> Space:
    """The project of runs, with a flap that an arm of one joint pushes, and a camera that sees it."""
    built(space)
    space.write("data/gate.json", stored(task()))
    space.write("data/cell.json", stored(cells.cell(rate_hz=10.0)))
    text = STORED.replace("NAME", "cell").replace("KIND", "Cell").replace("tasks.task", "robots.cell")
    space.write("rules/demo/cell.py", text.lstrip())
    space.write("rules/learn/line/policy.py", POLICY.replace("TARGET", str(gate.target(gate.PUSHES))).lstrip())
    space.write("recipes/task/gate.yaml", RECIPE)
    done = space.build("task/gate")
    assert done.code == 0, done.err[-3000:]
    return space


@pytest.mark.slow
def test_a_run_finds_its_objects_in_the_pictures_of_the_robot(space: Space) -> None:
    project(space)
    robot = started(space, *CELL, *NAMES, target="task/gate", names=())
    try:
        command = ("run", "task/gate", "--policy", "task/gate:policy", "--json", "--limit", "15", *NAMES)
        blind = space.dxb(*command)
        assert blind.code == 4
        assert "/tf is published: nobody publishes it" in blind.err
        doctor = space.dxb("robot", "doctor", "task/gate", "--json", *CELL, *NAMES)
        assert doctor.code == 0, doctor.err
        assert "tracker: case is found" in doctor.err
        assert "/tf of case arrives" in {each["check"] for each in doctor.document["checks"]}
        beside = space.start("robot", "track", "task/gate", "--json", *CELL, *NAMES)
        assert beside.stderr is not None
        while "is found" not in (line := beside.stderr.readline()):
            assert line, "the tracker ended"
        beside.send_signal(signal.SIGINT)
        told = documents.read(beside.communicate(timeout=60)[0])
        assert told["frames"] > 0
        assert set(told["tracked"]) == {"case"}
        done = space.dxb(*command, *CELL, "--out", "seen.mcap")
    finally:
        heard = ended(robot)
    assert done.out, done.err
    told = done.document
    assert (done.code, told["reason"], told["success"]) == (0, "the task is done", True), done.err
    assert (heard["success"], heard["commands_after_stop"]) == (True, 0)
    with (space.root / "seen.mcap").open("rb") as stream:
        run = robot_run.read(stream, "seen.mcap", task())
        stream.seek(0)
        counts = {each.topic: each.count for each in reading.index(stream, "seen.mcap")[0]}
    assert counts["/tf"] > 10
    opened = [float(each.displacement[0]) for each in run.measured]
    assert opened[0] == pytest.approx(0.0, abs=0.05)
    assert opened[-1] == pytest.approx(0.9, abs=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("killed", ["tracker", "run"])
def test_a_process_that_is_killed_leaves_the_robot_held_and_no_tracker(space: Space, killed: str) -> None:
    project(space)
    slowly = ("--speed", "0.05", "--limit", "60", "--out", "killed.mcap")
    robot = started(space, *CELL, *NAMES, target="task/gate", names=())
    try:
        run = space.start("run", "task/gate", "--policy", "task/gate:policy", "--json", *CELL, *NAMES, *slowly)
        assert run.stderr is not None
        while "to stop" not in (line := run.stderr.readline()):
            assert line, "the run ended"
        (tracker,) = map(int, Path(f"/proc/{run.pid}/task/{run.pid}/children").read_text().split())
        time.sleep(2.0)  # ten control periods
        os.kill(tracker if killed == "tracker" else run.pid, signal.SIGKILL)
        out, err = run.communicate(timeout=60)
        time.sleep(1.0)
    finally:
        heard = ended(robot)
    end = time.monotonic() + 30
    while Path(f"/proc/{tracker}").exists():
        assert time.monotonic() < end, "the tracker did not end"
        time.sleep(0.1)
    assert heard["commands"] > 0
    assert heard["commands_after_stop"] == 0
    if killed == "tracker":
        told = documents.read(out)
        assert run.returncode == 1, err
        assert told["reason"] == ("the guard stopped the robot: no frame arrived for more than 0.5 s on /tf of case")
        assert heard["commands"] == told["steps"]


@pytest.mark.slow
def test_a_tracker_without_a_camera_says_so(space: Space) -> None:
    project(space)
    robot = started(space, *NAMES, target="task/gate", names=())
    try:
        done = space.dxb("run", "task/gate", "--policy", "task/gate:policy", *CELL, *NAMES)
        assert done.code == 4
        assert "DXB-E445" in done.err
        assert (
            "nothing arrived on /workspace/aligned_depth_to_color/image_raw, /workspace/color/camera_info" in done.err
        )
        assert not list(space.root.glob("runs/*"))
        bare = space.dxb("robot", "track", "task/gate", *NAMES)
        assert (bare.code, "DXB-U350" in bare.err) == (2, True)
        both = space.dxb("robot", "simulate", "task/gate", *CELL, "--view", "task/try:view", *NAMES)
        assert (both.code, "DXB-U351" in both.err) == (2, True)
    finally:
        ended(robot)
