"""`dxb robot` and `dxb run`: a policy of a recipe drives a simulated robot over DDS, in processes of their own."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from dextera_build.cli.robot.stopping import EVENT
from dextera_build.formats.ros import reading
from dextera_build.policy import robot_run
from dextera_build.sim.model.model import compile_folder
from dextera_build.sim.runtime.palms import Palms
from tests import documents
from tests.e2e.page import blocks
from tests.e2e.robots import DOMAIN, LINE, NAMES, PICTURES, SEEING, TARGETS, built, ended, lift, ran, started
from tests.e2e.space import Space

pytest.importorskip("cyclonedds", reason="needs cyclonedds (extra `ros`)")

FOLLOWS = """
summary: A policy that sees a term of the project.
extends: task/try
nodes:
  palm_to_object: {rule: terms.palm_to_object}
  seen:
    rule: demonstrate.operate
    backend: stub
    bundle: $task
    episodes: 1
    terms: {palm_to_object: $palm_to_object}
  policy: {rule: learn.follow, bundle: $task, episodes: $seen}
targets:
  default: [policy]
"""
FOLLOW = (
    LINE.replace("learn.line: a policy that goes to one place", "learn.follow: a policy that goes to the object")
    .replace("Line", "Follow")
    .replace("line", "follow")
    .replace("import TaskBundle", "import TaskBundle\nfrom dextera_build.artifacts.tasks.episode import Episodes")
    .replace("bundle: TaskBundle,", "bundle: TaskBundle, episodes: Episodes,")
    .replace("of_bundle(bundle)", "of_bundle(bundle, terms=episodes.terms.values())")
    .replace('contract.channel(here, "objects")', 'contract.channel(here, "palm_to_object")')
)
FOLLOWED = '''
"""Runs policies of learn.follow."""
import numpy as np

def predict(checkpoint, bundle):
    """Joint targets [m]: the rails go a tenth of the way from where they are to the object."""
    def act(inputs, step):
        way = 0.1 * inputs["palm_to_object"][0, 0]
        return np.array([[*(inputs["joints"][0, 0, :3] + way), 0.04, 0.04]])
    return act
'''


@pytest.mark.slow
def test_a_policy_drives_a_robot_over_dds(space: Space) -> None:
    built(space)
    nobody = space.dxb("run", "task/try", "--policy", "task/try:policy", *NAMES)
    assert nobody.code == 4
    assert "nobody publishes it" in nobody.err
    assert list(space.root.glob("runs/*")) == []
    wrong = space.dxb("run", "task/try", "--policy", "task/try:names", *NAMES)
    assert "DXB-U345" in wrong.err

    robot = started(space, *SEEING)
    try:
        doctor = space.dxb("robot", "doctor", "task/try", "--json", *NAMES, *SEEING)
        assert doctor.code == 0, doctor.err
        checks = doctor.document
        assert checks["failed"] == 0
        assert f"{PICTURES} arrives" in {each["check"] for each in checks["checks"]}
        unnamed = space.dxb("robot", "doctor", "task/try", "--domain", DOMAIN)
        assert unnamed.code == 1
        assert "nobody reads it" in unnamed.err
        code, told = ran(space, "whole.mcap", *SEEING)
    finally:
        heard = ended(robot)
    assert (code, told["reason"]) == (0, "not done within 4 s")
    assert 2 * told["steps"] == heard["commands"] == 40
    assert heard["commands_after_stop"] == 0
    assert heard["joints"] == pytest.approx(TARGETS, abs=5e-3)
    assert heard["status"] == ["running", "stopped: not done within 4 s"]
    with (space.root / "whole.mcap").open("rb") as stream:
        found, _, _ = reading.index(stream, "whole.mcap")
    counts = {each.topic: each.count for each in found}
    assert counts["/rails/commands"] == counts["/hand/trajectory"] == counts["/requested/joint_trajectory"] == 20
    assert counts["/joint_states"] > 100
    assert counts[PICTURES] > 5
    assert counts["/robot_description"] == counts["/scene/objects"] == counts["/tf_static"] == 1
    done = space.build("task/from_robot", "--input", "task=task/try:task", "--input", "runs=whole.mcap")
    assert done.code == 0, done.err[-3000:]
    assert "0 of 1" in space.dxb("show", "task/from_robot:trials").out


@pytest.mark.slow
def test_a_policy_sees_a_term_of_the_project_on_a_robot(space: Space) -> None:
    built(space)
    space.write("rules/terms/palm_to_object.py", blocks("terms", "python")[0])
    space.write("rules/learn/follow/follow.py", FOLLOW.lstrip())
    space.write("rules/learn/follow/policy.py", FOLLOWED.lstrip())
    space.write("recipes/task/follow.yaml", FOLLOWS)
    done = space.build("task/follow")
    assert done.code == 0, done.err[-3000:]
    robot = started(space)
    try:
        code, _ = ran(space, "near.mcap", policy="task/follow:policy")
    finally:
        ended(robot)
    assert code == 0
    bundle = lift()
    with (space.root / "near.mcap").open("rb") as stream:
        run = robot_run.read(stream, "near.mcap", bundle)
    palms = Palms(bundle.robot, compile_folder(bundle.model))
    for measured, requested in zip(run.measured, run.requested, strict=False):
        way = measured.objects[0, :3] - palms(measured.joints[None])[0, 0, :3]
        assert requested[:3] == pytest.approx(measured.joints[:3] + 0.1 * way, abs=1e-5)
    assert np.ptp(run.requested[:, :3], axis=0).max() > 0.01


@pytest.mark.slow
def test_a_robot_that_falls_silent_over_dds_is_not_moved_any_more(space: Space) -> None:
    built(space)
    robot = started(space, "--fault", "joint_states_stop@1")
    try:
        code, told = ran(space, "cut.mcap")
    finally:
        heard = ended(robot)
    assert code == 1
    assert told["reason"] == "the guard stopped the robot: no joint states arrived for more than 0.4 s"
    assert heard["commands"] == 2 * told["steps"] < 40
    assert heard["commands_after_stop"] == 0


@pytest.mark.slow
def test_a_demonstration_is_recorded_while_another_program_commands(space: Space) -> None:
    built(space)
    robot = started(space)
    recorder = space.start("robot", "record", "task/try", "--out", "demo.mcap", "--limit", "2", "--json", *NAMES)
    try:
        assert recorder.stderr is not None
        while "waiting for the first command" not in (line := recorder.stderr.readline()):
            assert line, "the recorder ended"
        code, _ = ran(space, "driven.mcap")
        out, err = recorder.communicate(timeout=60)
    finally:
        heard = ended(robot)
    assert (code, recorder.returncode) == (0, 0), err
    told = documents.read(out)
    assert (told["reason"], told["steps"], told["success"]) == ("not done within 2 s", 10, False)
    assert heard["commands"] == 40  # those of the run alone
    done = space.build("task/from_robot:episodes", "--input", "task=task/try:task", "--input", "runs=demo.mcap")
    assert done.code == 1
    assert "none of 1 recordings shows `LiftBox` done" in done.err


@pytest.mark.slow
def test_a_policy_of_another_process_drives_a_robot_over_dds(space: Space) -> None:
    pytest.importorskip("websockets", reason="needs websockets (extra `serve`)")
    built(space)
    server = space.start("serve", "task/try:policy", "--port", "0", "--json")
    assert server.stdout is not None
    address = documents.read(server.stdout.readline())["url"]
    robot = started(space)
    try:
        code, told = ran(space, "served.mcap", policy=address)
    finally:
        heard = ended(robot)
        server.send_signal(signal.SIGINT)
        assert server.wait(60) == 0
    assert (code, told["reason"]) == (0, "not done within 4 s")
    assert 2 * told["steps"] == heard["commands"] == 40
    assert heard["joints"] == pytest.approx(TARGETS, abs=5e-3)
    nobody = space.dxb("run", "task/try", "--policy", address, *NAMES)
    assert nobody.code == 4
    assert "DXB-E328" in nobody.err


def moving(space: Space, policy: str, *more: str) -> subprocess.Popen[str]:
    """A run that has begun to move the robot."""
    words = ("run", "task/try", "--policy", policy, "--out", "killed.mcap", "--json", "--limit", "60")
    made = space.start(*words, *NAMES, *more)
    assert made.stderr is not None
    while "press Ctrl-C to stop" not in (line := made.stderr.readline()):
        assert line, "the run ended"
    time.sleep(2.0)  # ten control periods
    return made


@pytest.mark.slow
def test_a_policys_process_that_is_killed_leaves_the_robot_held(space: Space) -> None:
    pytest.importorskip("websockets", reason="needs websockets (extra `serve`)")
    built(space)
    server = space.start("serve", "task/try:policy", "--port", "0", "--json")
    assert server.stdout is not None
    robot = started(space)
    try:
        run = moving(space, documents.read(server.stdout.readline())["url"])
        server.kill()
        out, err = run.communicate(timeout=60)
        time.sleep(1.0)
    finally:
        heard = ended(robot)
        server.kill()
        server.wait(60)
    told = documents.read(out)
    assert run.returncode == 1, err
    assert "the connection to the policy at" in told["reason"]
    assert told["steps"] >= 1
    assert heard["commands"] == 2 * told["steps"]
    assert heard["commands_after_stop"] == 0
    assert heard["status"][-1].startswith("stopped: the connection to the policy at")
    bundle = lift()
    with (space.root / "killed.mcap").open("rb") as stream:
        run_made = robot_run.read(stream, "killed.mcap", bundle)
    assert len(run_made.sent) == told["steps"]
    assert heard["joints"] == pytest.approx(dict(zip(TARGETS, run_made.sent[-1], strict=True)), abs=5e-3)


@pytest.mark.slow
def test_a_pedal_stops_a_run(space: Space) -> None:
    built(space)
    pedal = space.root / "pedal"
    os.mkfifo(pedal)
    foot = os.open(pedal, os.O_RDWR)
    robot = started(space)
    try:
        run = moving(space, "task/try:policy", "--pedal", str(pedal))
        os.write(foot, EVENT.pack(1, 2, 1, 30, 1))
        out, err = run.communicate(timeout=60)
        time.sleep(1.0)
    finally:
        heard = ended(robot)
        os.close(foot)
    told = documents.read(out)
    assert run.returncode == 1, err
    assert told["reason"] == "the guard stopped the robot: the operator stopped it"
    assert heard["commands"] == 2 * told["steps"] > 0
    assert heard["commands_after_stop"] == 0
    assert heard["status"][-1] == f"stopped: {told['reason']}"


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
