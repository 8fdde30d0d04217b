"""Simulated robots in real time and over DDS, in a thread of their own."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from dextera_build.artifacts.robots.ros_names import RosNames
from dextera_build.deploying import topics as tables
from dextera_build.deploying.cell import RosCell
from dextera_build.deploying.dds import Dds
from dextera_build.deploying.faults import Fault
from dextera_build.deploying.simulated import STATE_HZ, SimulatedRobot, Simulation
from dextera_build.policy.observation import Frame
from dextera_build.sim.runtime.environment import Environment
from tests import task_bundles

DOMAIN = 120 + os.getpid() % 80


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
def running(rate_hz: float, *faults: Fault) -> Iterator[tuple[Real, RosCell]]:
    """A robot in which something goes wrong, and a cell connected to it, both by DDS."""
    made = task_bundles.lift()
    made = made.model_copy(update={"task": made.task.model_copy(update={"control_hz": rate_hz})})
    topics = tables.of_robot(made.robot, RosNames(), ("workspace",))
    environment = Environment(made)
    noise = np.random.default_rng(0)
    ours, theirs = Dds(domain=DOMAIN), Dds(domain=DOMAIN)
    simulation = Simulation(loss=0.0, faults=faults)
    robot = SimulatedRobot(
        theirs,
        topics,
        environment,
        simulation,
        lambda: {"workspace": Frame(noise.integers(0, 255, (24, 32, 3), np.uint8))},
    )
    real = Real(robot)
    thread = threading.Thread(target=real.run)
    thread.start()
    try:
        cell = RosCell(ours, topics, made, ("objects", "rgb"))
        time.sleep(1.0)  # as `dxb run` listens at first, so that a late first message is no jump of the clock
        yield real, cell
    finally:
        real.ended.set()
        thread.join(10)
        ours.close()
        theirs.close()
