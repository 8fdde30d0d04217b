"""`dxb robot` and `dxb run`: a policy of a recipe drives a simulated robot over DDS, in processes of their own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest

from dextera_build.formats.ros import reading
from tests.e2e.space import Space
from tests.e2e.test_serve import TASK

pytest.importorskip("cyclonedds", reason="needs cyclonedds (extra `ros`)")

DOMAIN = str(110 + os.getpid() % 80)
RECIPE = TASK.replace("timeout_s: 1", "timeout_s: 4\n    control_hz: 5").replace(
    "  act_twin: {rule: evaluate.rollouts, bundle: $task, checkpoint: $act, trials: 2}",
    "  names: {rule: simulate.ros_names, robot: $robot, controllers: [{topic: /all/commands, kind: forward}]}",
)
RECIPE = RECIPE.replace("default: [act_twin]", "default: [act, names]")
REAL = ("simulate.task=mujoco", "learn.act=torch")
FLAGS = ("--profile", "stub", *(word for backend in REAL for word in ("--backend", backend)))
NAMES = ("--names", "task/try:names", "--domain", DOMAIN)


def started(space: Space, *more: str) -> subprocess.Popen[str]:
    """A simulated robot that moves when it is told to."""
    made = space.start("robot", "simulate", "task/try", "--json", *NAMES, *more)
    assert made.stderr is not None
    while "simulated robot" not in (line := made.stderr.readline()):
        assert line, "the robot ended"
    return made


def ended(robot: subprocess.Popen[str]) -> dict[str, Any]:
    """What happened to it."""
    robot.send_signal(signal.SIGINT)
    out, err = robot.communicate(timeout=60)
    assert robot.returncode == 0, err
    found: dict[str, Any] = json.loads(out)
    return found


def ran(space: Space, out: str) -> tuple[int, dict[str, Any]]:
    """A run of the policy: exit code and what it tells."""
    command = ("run", "task/try", "--policy", "task/try:act", "--robot", "127.0.0.1", "--out", out, "--json")
    done = space.run(*command, *NAMES)
    assert done.out, done.err
    return done.code, json.loads(done.out)


@pytest.mark.slow
def test_a_policy_drives_a_robot_over_dds(space: Space) -> None:
    space.write("recipes/task/try.yaml", RECIPE)
    built = space.build("task/try", *FLAGS)
    assert built.code == 0, built.err[-3000:]
    nobody = space.run("run", "task/try", "--policy", "task/try:act", *NAMES)
    assert nobody.code == 4
    assert "nobody publishes it" in nobody.err
    wrong = space.run("run", "task/try", "--policy", "task/try:names", *NAMES)
    assert "DXB-U345" in wrong.err

    robot = started(space)
    try:
        doctor = space.run("robot", "doctor", "task/try", "--json", *NAMES)
        assert doctor.code == 0, doctor.err
        assert json.loads(doctor.out)["failed"] == 0
        unnamed = space.run("robot", "doctor", "task/try", "--domain", DOMAIN)
        assert unnamed.code == 1
        assert "nobody reads it" in unnamed.err
        code, told = ran(space, "whole.mcap")
    finally:
        heard = ended(robot)
    assert (code, told["reason"]) == (0, "not done within 4 s")
    assert told["steps"] == heard["commands"] == 20
    assert heard["commands_after_stop"] == 0
    assert heard["status"] == ["running", "stopped: not done within 4 s"]
    with (space.root / "whole.mcap").open("rb") as stream:
        found, _, _ = reading.index(stream, "whole.mcap")
    counts = {each.topic: each.count for each in found}
    assert counts["/all/commands"] == counts["/requested/joint_trajectory"] == 20
    assert counts["/joint_states"] > 200

    robot = started(space, "--fault", "joint_states_stop@1")
    try:
        code, told = ran(space, "cut.mcap")
    finally:
        heard = ended(robot)
    assert code == 1
    assert told["reason"] == "the guard stopped the robot: no joint states arrived for more than 0.4 s"
    assert heard["commands"] == told["steps"] < 20
    assert heard["commands_after_stop"] == 0


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("robot", "simulate", "say/words:start"), "DXB-U333"),
        (("robot", "doctor", "say/words:start"), "DXB-U333"),
        (("run", "say/words", "--policy", "say/words:start", "--speed", "2"), "DXB-U347"),
    ],
)
def test_what_is_no_task_is_refused(words: tuple[str, ...], code: str, space: Space) -> None:
    assert space.build("say/words").code == 0
    done = space.dxb(*words)
    assert done.code == 2
    assert f"error[{code}]" in done.err
    assert not Path(space.root / "runs").exists()
