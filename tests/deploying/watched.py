"""A simulated robot whose objects nobody publishes but a tracker on its pictures, in virtual time."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import numpy as np

from dextera_build.artifacts.robots.cell import Cell
from dextera_build.artifacts.robots.ros_names import RosNames
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.variation import EXACT
from dextera_build.deploying import photographed
from dextera_build.deploying import topics as tables
from dextera_build.deploying.faults import Fault
from dextera_build.deploying.loopback import Loopback
from dextera_build.deploying.simulated import Simulation
from dextera_build.deploying.tracking import ObjectTracker, Watched
from dextera_build.policy.observation import Frame, Frames
from dextera_build.sim.runtime.cell_camera import CellCamera
from dextera_build.sim.runtime.cell_tracker import CellTracker
from dextera_build.sim.runtime.environment import Environment
from tests.deploying.robots import Rig


class Seen(Rig):
    """A robot with a camera, and a tracker that takes a constant time for each picture."""

    tracker: ObjectTracker | None = None
    looking: Watched | None = None
    delay_s = 0.0

    def sleep(self, seconds: float) -> None:
        """Let time pass, for the tracker too."""
        for _ in range(max(1, round(seconds * 100))):
            super().sleep(0.01)
            if self.looking is None or self.tracker is None:
                continue
            if (frame := self.looking.frame()) is not None:
                self._frames.append((self.time + round(self.delay_s * 1e9), frame))
            if self._frames and self._frames[0][0] <= self.time:
                self.tracker.step(*self._frames.popleft()[1])

    def watch(self, twin: TaskBundle, names: RosNames, tracker: CellTracker) -> None:
        """Track from now on."""
        self._frames: deque[tuple[int, Any]] = deque()
        link, topics = Loopback(self.bus), tables.of_robot(twin.robot, names, ("workspace",))
        self.delay_s, self.looking = tracker.cell.delay_s, Watched(link, topics, twin)
        scene = photographed.drawn(twin, tracker.cell, tracker.camera)
        self.tracker = ObjectTracker(link, topics, twin, tracker, scene)


@contextmanager
def watched(
    world: TaskBundle,
    twin: TaskBundle,
    cell: Cell,
    names: RosNames | None = None,
    *,
    seed: int,
    faults: tuple[Fault, ...] = (),
    **more: Any,
) -> Iterator[Seen]:
    """A world before the camera of its cell.

    Args:
        world: What is simulated.
        twin: What is known of it.
        cell: Its camera and tracker.
        names: Names in ROS 2.
        seed: Seed of the start and of all noise.
        faults: What goes wrong.
        more: Of `Rig`.
    """
    names, random, held = names or RosNames(), np.random.default_rng([seed, cell.seed, 3]), ExitStack()
    eyes: list[CellCamera] = []

    def look(there: Environment) -> Frames:
        if not eyes:
            eyes.append(held.enter_context(CellCamera(there, cell)))
        return {"workspace": Frame(*eyes[0].measured(eyes[0].picture(), random))}

    simulation = Simulation(picture_hz=cell.rate_hz, loss=cell.loss, tracks=False, faults=faults, seed=seed)
    with held:
        rig = Seen(names, simulation, look=look, bundle=world, intrinsics=cell.camera, **more)
        there = rig.robot.environment
        there.begin(there.draw(seed).model_copy(update={"base_error": EXACT}))
        rig.watch(twin, names, held.enter_context(CellTracker(cell, twin, twin.objects, twin)))
        yield rig
