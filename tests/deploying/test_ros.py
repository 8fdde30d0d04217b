"""A cell drives a node of ROS 2 with Fast DDS, and lets go of it when the node falls silent."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="needs cyclonedds (extra `ros`)")

from dextera_build.artifacts.robots.ros_names import RosNames
from dextera_build.deploying import topics as tables
from dextera_build.deploying.bag import Bag
from dextera_build.deploying.cell import RosCell
from dextera_build.deploying.checkup import checkup
from dextera_build.deploying.dds import Dds
from dextera_build.deploying.driving import Drive, drive
from dextera_build.formats.ros import reading
from tests import task_bundles
from tests.deploying import peers
from tests.deploying.robots import Line

DOMAIN = 20 + (os.getpid() + 40) % 80
RATE_HZ = 5.0
"""Slow, because a silence of two periods must not come from a busy machine."""
TARGETS = np.array([0.05, -0.04, 0.03, 0.04, 0.04])


@pytest.mark.slow
@pytest.mark.parametrize("cut_s", [0.0, 2.0])
def test_a_node_of_ros_2_is_driven(cut_s: float, tmp_path: Path) -> None:
    made = task_bundles.lift()
    made = made.model_copy(update={"task": made.task.model_copy(update={"control_hz": RATE_HZ})})
    topics = tables.of_robot(made.robot, RosNames())
    with peers.robot(DOMAIN, 30.0, tmp_path / "got.json", task_bundles.HOME_M) as node:
        transport = Dds(domain=DOMAIN)
        bag = Bag.create(tmp_path / "run.mcap")
        cell = RosCell(transport, topics, made, (), bag=bag)
        checks = checkup(transport, topics, cell, made.robot, time.sleep)
        assert {each.what: each.found for each in checks if not each.ok} == {}
        cutter = threading.Timer(2.0, node.freeze, kwargs={"stop": True})
        if cut_s:
            cutter.start()
        ran: Drive = drive(cell, Line(TARGETS), np.zeros(1), rate_hz=RATE_HZ, limit_s=6.0)
        if cut_s:
            time.sleep(cut_s)
            node.freeze(stop=False)
        last = cell.state.last
        got = node.ended()
        transport.close()
        bag.close()
    assert got["late"] == 0
    assert got["status"][-1] == f"stopped: {ran.reason}"
    assert ran.faulty == bool(cut_s), ran.reason
    if cut_s:
        assert "no joint states arrived for more than 0.4 s" in ran.reason
        return
    assert last is not None
    assert last.value == pytest.approx(TARGETS, abs=1e-6)
    assert len(got["trajectories"]) == ran.steps == 30
    assert max(ran.delays_s) < 0.5
    with (tmp_path / "run.mcap").open("rb") as stream:
        assert {each.topic for each in reading.index(stream, "run.mcap")[0]} >= {"/joint_states", "/joint_trajectory"}
