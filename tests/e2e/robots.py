"""A project with a policy for a simulated robot, and both in processes of their own."""

from __future__ import annotations

import base64
import json
import os
import signal
import subprocess
from typing import Any

import pytest

from dextera_build import digest
from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.tasks.task import TaskBundle, View
from tests import documents, factories, task_bundles
from tests.e2e.space import Space

DOMAIN = str(110 + os.getpid() % 80)
STORED = '''
"""demo.NAME: an artifact from a file."""
import base64
import json
from dextera_build.artifacts.base import File
from dextera_build.artifacts.tasks.task import KIND
from dextera_build.rule import Context, Options, rule

class KINDOptions(Options):
    """Options."""

@rule(version=1)
def NAME(ctx: Context, stored: File, *, options: KINDOptions) -> KIND:
    """Return the artifact."""
    read = json.loads(stored.data)
    return KIND.decode(read["key"], lambda key: base64.b64decode(read["blobs"][key]))
'''
# Trials run the code of the task's primitive.
TASK = (
    STORED.replace("NAME", "task")
    .replace("KIND", "TaskBundle")
    .replace('"""Options."""', '"""Options."""\n    primitive: str = "lift"\n    """Its primitive."""')
    .replace("version=1", 'version=1, folders={"primitive": "primitives"}')
)
ROBOT = '''
"""demo.robot: the robot of a task."""
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.rule import Context, Options, rule

class RobotOptions(Options):
    """Options."""

@rule(version=1)
def robot(ctx: Context, bundle: TaskBundle, *, options: RobotOptions) -> RobotModel:
    """Return the robot."""
    return bundle.robot
'''
LINE = '''
"""learn.line: a policy that goes to one place."""
import numpy as np
from dextera_build.artifacts.tasks.policy import Channel, Checkpoint, PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy import contract
from dextera_build.policy.layout import of_bundle
from dextera_build.rule import Context, Options, rule

class LineOptions(Options):
    """Options."""

@rule(version=1)
def line(ctx: Context, bundle: TaskBundle, *, options: LineOptions) -> Checkpoint:
    """Return the policy."""
    here = of_bundle(bundle)
    return Checkpoint(
        weights=(2).to_bytes(8, "little") + b"{}",
        contract=PolicyContract(
            algorithm="line", task=here.task, embodiment=here.embodiment, rate_hz=here.rate_hz, dataset="", settings={},
            inputs=(contract.channel(here, "joints"), contract.channel(here, "objects")),
            action=Channel(name="action", shape=(len(here.joints),), names=here.joints),
        ),
        steps=np.zeros(0, np.int64), curve=np.zeros(0, np.float32), curve_name="none",
    )
'''
POLICY = '''
"""Runs policies of learn.line."""
import numpy as np

def predict(checkpoint, bundle):
    """Joint targets [m], the same at every step."""
    return lambda inputs, step: np.array([[0.03, -0.02, 0.05, 0.04, 0.04]])
'''
RECIPE = """
summary: A task from a file, and a policy for it.
inputs:
  stored: data/task.json
  camera: data/view.json
nodes:
  task: {rule: demo.task, stored: $stored, lift: {height_m: 0.1}}
  view: {rule: demo.view, stored: $camera}
  robot: {rule: demo.robot, bundle: $task}
  names:
    rule: simulate.ros_names
    robot: $robot
    controllers:
      - {topic: /rails/commands, kind: forward, joints: [x, y, z]}
      - {topic: /hand/trajectory, joints: [left, right]}
  policy: {rule: learn.line, bundle: $task}
targets:
  default: [policy, names, view]
"""
NAMES = ("--names", "task/try:names", "--domain", DOMAIN)
SEEING = ("--view", "task/try:view")
PICTURES = "/workspace/color/image_raw/compressed"
TARGETS = {"x": 0.03, "y": -0.02, "z": 0.05, "left": 0.04, "right": 0.04}


def stored(artifact: Artifact) -> str:
    """An artifact with its parts as one text."""
    blobs: dict[str, str] = {}

    def put(data: bytes) -> str:
        key = digest.of_bytes(data)
        blobs[key] = base64.b64encode(data).decode()
        return key

    return json.dumps({"key": artifact.encode(put), "blobs": blobs})


def lift() -> TaskBundle:
    """A task with long control periods, because the machine of a test is busy."""
    made = task_bundles.lift()
    return made.model_copy(update={"task": made.task.model_copy(update={"control_hz": 5.0})})


def built(space: Space) -> Space:
    """The project with a task and a policy."""
    made = lift()
    camera = factories.placed(factories.look_at((0.5, -0.5, 0.7)), "camera")
    space.write("data/task.json", stored(made))
    space.write("data/view.json", stored(View(camera=factories.camera(64, 48), camera_pose=camera)))
    rules = {"demo/robot.py": ROBOT, "learn/line/line.py": LINE, "learn/line/policy.py": POLICY}
    rules["demo/view.py"] = STORED.replace("NAME", "view").replace("KIND", "View")
    rules["demo/task.py"] = TASK
    for name, text in rules.items():
        space.write(f"rules/{name}", text.lstrip())
    space.write("recipes/task/try.yaml", RECIPE)
    done = space.build("task/try")
    assert done.code == 0, done.err[-3000:]
    return space


def started(
    space: Space, *more: str, target: str = "task/try", names: tuple[str, ...] = NAMES
) -> subprocess.Popen[str]:
    """A simulated robot that moves when it is told to."""
    made = space.start("robot", "simulate", target, "--json", *names, *more)
    assert made.stderr is not None
    while "simulated robot" not in (line := made.stderr.readline()):
        assert line, "the robot ended"
    return made


def ended(robot: subprocess.Popen[str]) -> dict[str, Any]:
    """What happened to it."""
    robot.send_signal(signal.SIGINT)
    out, err = robot.communicate(timeout=60)
    assert robot.returncode == 0, err
    return documents.read(out)


def ran(space: Space, out: str, *more: str, policy: str = "task/try:policy") -> tuple[int, dict[str, Any]]:
    """A run of the policy: exit code and what it tells."""
    command = ("run", "task/try", "--policy", policy, "--robot", "127.0.0.1", "--out", out, "--json")
    done = space.dxb(*command, *NAMES, *more)
    assert done.out, done.err
    return done.code, done.document


def drove(space: Space, robot: subprocess.Popen[str], *more: str) -> None:
    """A started robot passes the checks, its policy runs to the end of its time, and both sides tell the same."""
    try:
        doctor = space.dxb("robot", "doctor", "task/try", "--json", *NAMES, *SEEING, *more)
        assert (doctor.code, doctor.document["failed"]) == (0, 0), doctor.err
        code, told = ran(space, "whole.mcap", *SEEING, *more)
    finally:
        heard = ended(robot)
    assert (code, told["reason"]) == (0, "not done within 4 s")
    assert 2 * told["steps"] == heard["commands"] == 40
    assert heard["joints"] == pytest.approx(TARGETS, abs=5e-3)
    assert heard["status"] == ["running", "stopped: not done within 4 s"]
