"""`dxb robot doctor` and `dxb run` by rclpy, against a robot of DDS, in processes of their own."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.deploying import peers
from tests.e2e.robots import NAMES, SEEING, ended, started
from tests.e2e.space import Space
from tests.e2e.test_replay import STEPS, moved, with_episodes

pytest.importorskip("cyclonedds", reason="needs cyclonedds (extra `ros`)")


@pytest.mark.slow
def test_an_episode_drives_a_robot_of_dds_through_rclpy(space: Space, monkeypatch: pytest.MonkeyPatch) -> None:
    # Where no other is named, it is the `python3` of the path, as after `source setup.bash`.
    monkeypatch.setenv("PATH", f"{Path(peers.python()).parent}{os.pathsep}{os.environ['PATH']}")
    with_episodes(space)
    robot = started(space, *SEEING)
    try:
        rclpy = (*NAMES, *SEEING, "--transport", "rclpy", "--json")
        doctor = space.dxb("robot", "doctor", "task/try", *rclpy)
        assert (doctor.code, doctor.document["failed"]) == (0, 0), doctor.err
        # The environment of the tests has no tf2_msgs, which only policies with objects need.
        which = ("--replay", "task/try:episodes", "--speed", "1", "--ramp", "0")
        done = space.dxb("run", "task/try", *which, "--out", "by_rclpy.mcap", *rclpy)
    finally:
        heard = ended(robot)
    assert done.code == 0, done.err
    assert 2 * done.document["steps"] == heard["commands"] == 2 * (STEPS + 5)
    assert heard["commands_after_stop"] == 0
    assert list(heard["joints"].values()) == pytest.approx(moved().items["0"].executed[-1], abs=5e-3)
    assert heard["status"] == ["running", f"stopped: {done.document['reason']}"]
