"""A demonstration holds the commands of another program, and says which it waits for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs rosbags (extra `ros`)")

from dextera_build.artifacts.robots.ros_names import Controller, RosNames
from dextera_build.cli.robot import record
from dextera_build.deploying.loopback import Loopback
from dextera_build.formats.ros import hashes, messages
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


def test_a_plan_of_several_points_is_followed_and_a_cancelled_one_is_held() -> None:
    rig = Rig()
    watcher, other = Watcher(rig), Loopback(rig.bus)
    rig.sleep(0.3)
    (controller,) = watcher.topics.controllers
    watcher.cell.begin()
    first = watcher.cell.state.last
    assert first is not None
    begin = rig.time

    def publish(points: dict[float, float]) -> None:
        every = [(np.array([place, 0.0, 0.0, 0.05, 0.05]), seconds) for seconds, place in points.items()]
        other.publish(controller.topic, trajectory(begin, every))

    def action() -> float:
        watcher.made.step()
        return float(watcher.made._plans.at(rig.time + 50_000_000)[0])

    publish({1.0: 0.06, 2.0: 0.12, 5.0: 0.30})
    assert watcher.made.commanded
    start = float(first.value[0])
    assert action() == pytest.approx(start + (0.06 - start) * 0.05, abs=1e-6)
    rig.sleep(0.95)
    assert action() == pytest.approx(0.06, abs=1e-6)
    rig.sleep(2.0)
    held = action()
    assert held == pytest.approx(0.18, abs=1e-6)
    assert rig.robot.environment.measure().joints[0] == pytest.approx(0.177, abs=3e-3)
    publish({})
    rig.sleep(1.0)
    assert action() == pytest.approx(held, abs=4e-3)
    assert rig.robot.environment.measure().joints[0] == pytest.approx(0.177, abs=3e-3)


def trajectory(stamp: int, points: list[tuple[np.ndarray, float]]) -> bytes:
    """A trajectory with targets (5,) of all joints and when each is reached [s]."""
    kind = "trajectory_msgs/JointTrajectory"
    whole = hashes.read(kind, messages.joint_trajectory(stamp, ["x", "y", "z", "left", "right"], np.zeros(5), 1))
    point = whole.points[0]
    whole.points = [
        replace(point, positions=places, time_from_start=replace(point.time_from_start, sec=int(at), nanosec=0))
        for places, at in points
    ]
    return bytes(hashes.store().serialize_cdr(whole, "trajectory_msgs/msg/JointTrajectory"))


@pytest.mark.parametrize(
    ("points", "why"),
    [
        ([(np.zeros(5), 2.0), (np.ones(5), 1.0)], "its times do not increase"),
        ([(np.full(5, np.nan), 1.0)], "its targets are not finite"),
        ([(np.zeros(3), 1.0)], "its number of targets is 3"),
    ],
)
def test_a_command_that_its_controller_refuses_is_none(points: list[tuple[np.ndarray, float]], why: str) -> None:
    rig = Rig()
    watcher, other = Watcher(rig), Loopback(rig.bus)
    rig.sleep(0.3)
    other.publish(watcher.topics.controllers[0].topic, trajectory(rig.time, points))
    assert not watcher.made.commanded
    assert why in watcher.made.waits_for()
    assert why in rig.robot.heard.unusable[0]
