"""The table of faults over DDS, in real time: each ends held and explained, and nothing moves after the stop."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="needs cyclonedds (extra `ros`)")
pytest.importorskip("rosbags", reason="needs rosbags (extra `ros`)")

from dextera_build.artifacts.robots.ros_names import RosNames
from dextera_build.deploying import topics as tables
from dextera_build.deploying.cell import RosCell
from dextera_build.deploying.dds import Dds
from dextera_build.deploying.driving import Drive, drive
from dextera_build.deploying.faults import FAULTS, Fault, FaultKind
from dextera_build.deploying.simulated import STATE_HZ, SimulatedRobot, Simulation
from dextera_build.formats.ros.reading import SECOND
from dextera_build.sim.runtime.environment import Environment
from tests import task_bundles
from tests.deploying.robots import Line

DOMAIN = 120 + os.getpid() % 80
RATE_HZ = 5.0
"""Slow, because a silence of two periods must not come from a busy machine."""
PERIODS_S = 2.0 / RATE_HZ
SILENCE_S = 0.5
"""Silence of pictures and poses that is allowed [s]."""
SLACK_S = 0.1
"""Delay of a busy machine, within which a command that was sent in time may arrive [s]."""
FAR = np.array([0.5, 0.4, 0.2, 0.04, 0.04])
"""Targets that the robot is still on its way to when the fault comes."""
SILENT = ("no joint states arrived for more than 0.4 s", "pictures and joint states are")
"""How joint states that are missing are told: a picture that belongs to none may come first."""
ENDS: dict[FaultKind, tuple[float | None, tuple[str, ...]]] = {
    "joint_states_stop": (PERIODS_S, SILENT),
    "joint_states_late": (PERIODS_S, ("joint states",)),
    "joint_states_lost": (None, SILENT),
    "pictures_stop": (SILENCE_S + PERIODS_S, ("no frame arrived for more than 0.5 s",)),
    "pictures_freeze": (None, ("`workspace` shows the same picture while the robot moves",)),
    "poses_stop": (SILENCE_S + PERIODS_S, ("no frame arrived for more than 0.5 s",)),
    "stamps_jump": (PERIODS_S, ("jumped by +3.00 s",)),
    "stamps_back": (PERIODS_S, ("jumped by -3.00 s",)),
    "nan": (PERIODS_S, ("is not a finite number",)),
    "joint_missing": (PERIODS_S, ("it lacks x",)),
    "joint_renamed": (PERIODS_S, ("it lacks x",)),
    "cut": (PERIODS_S, SILENT),
}
"""Fault -> longest time until the last command [s], None: it depends on chance or motion; what the reason may say."""


@dataclass
class Real:
    """A simulated robot in real time."""

    robot: SimulatedRobot
    ended: threading.Event = field(default_factory=threading.Event)

    def run(self) -> None:
        due = time.monotonic()
        while not self.ended.is_set():
            self.robot.tick()
            due = max(due + 1.0 / STATE_HZ, time.monotonic() - 0.05)
            time.sleep(max(0.0, due - time.monotonic()))

    def places(self) -> np.ndarray:
        return np.array(self.robot.environment.measure().joints)


@contextmanager
def running(kind: FaultKind) -> Iterator[tuple[Real, RosCell]]:
    """A robot in which something goes wrong, and a cell connected to it, both by DDS."""
    made = task_bundles.lift()
    made = made.model_copy(update={"task": made.task.model_copy(update={"control_hz": RATE_HZ})})
    topics = tables.of_robot(made.robot, RosNames(), ("workspace",))
    environment = Environment(made)
    noise = np.random.default_rng(0)
    ours, theirs = Dds(domain=DOMAIN), Dds(domain=DOMAIN)
    simulation = Simulation(loss=0.0, faults=(Fault(kind, at_s=1.0),))
    robot = SimulatedRobot(
        theirs, topics, environment, simulation, lambda: noise.integers(0, 255, (24, 32, 3), np.uint8)
    )
    real = Real(robot)
    thread = threading.Thread(target=real.run)
    thread.start()
    try:
        yield real, RosCell(ours, topics, made, ("objects", "rgb"))
    finally:
        real.ended.set()
        thread.join(10)
        ours.close()
        theirs.close()


@pytest.mark.slow
@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_over_dds_ends_held_and_explained(kind: FaultKind) -> None:
    longest, why = ENDS[kind]
    with running(kind) as (real, cell):
        ran: Drive = drive(cell, Line(FAR), np.zeros(1), rate_hz=RATE_HZ, limit_s=12.0)
        time.sleep(0.5)  # a controller reaches its last target
        place, heard = real.places(), real.robot.heard
        commands = heard.commands
        time.sleep(1.0)
        after = real.places()
    assert ran.faulty
    assert any(each in ran.reason for each in why), ran.reason
    assert ran.steps >= 3
    assert after == pytest.approx(place, abs=2e-3)
    assert (heard.commands, heard.after_stop) == (commands, 0)
    assert np.abs(after - FAR).max() > 0.02  # it was stopped on its way
    if longest is not None:
        assert (heard.last_ns - heard.faults[kind]) / SECOND <= longest + SLACK_S
    if kind != "cut":
        assert heard.status[-1] == f"stopped: {ran.reason}"
