"""A demonstration holds the commands of another program, and says which it waits for."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs rosbags (extra `ros`)")

from dextera_build.artifacts.robots.ros_names import Controller, RosNames
from dextera_build.cli.robot import record
from dextera_build.deploying.loopback import Loopback
from dextera_build.formats.ros import messages
from tests.deploying.robots import Rig, Watcher

NAMES = RosNames(
    controllers=(
        Controller(topic="/rails", joints=("x", "y", "z")),
        Controller(topic="/hand", kind="forward", joints=("left", "right")),
    )
)


def test_it_is_told_which_joints_lack_a_command(capsys: pytest.CaptureFixture[str]) -> None:
    rig = Rig(NAMES)
    watcher, other = Watcher(rig, names=NAMES), Loopback(rig.bus)
    rails, hand = (each.topic for each in watcher.topics.controllers)
    places = np.zeros(5)
    publishes = {
        8: (rails, messages.joint_trajectory(rig.time, ["x", "y", "z"], places[:3], 50_000_000)),
        14: (hand, messages.numbers("a", places[:1])),
        30: (hand, messages.numbers("ab", places[:2])),
    }
    passed = [0.0]

    def sleep(seconds: float) -> None:
        passed[0] += 1.0
        if passed[0] in publishes:
            other.publish(*publishes[int(passed[0])])

    record._await_commands(watcher.made, sleep, lambda: passed[0])
    assert passed[0] == 30.0
    silent = "no command yet for left, right on /hand"
    wrong = "a command on /hand cannot be used: its number of targets is 1, that of the controller's joints 2"
    told = capsys.readouterr().err.splitlines()
    assert told == ["no command yet for x, y, z on /rails; left, right on /hand", silent, f"{silent}; {wrong}"]
