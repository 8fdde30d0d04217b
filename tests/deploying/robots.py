"""Simulated robots on a bus in one thread and in virtual time, so that every run is the same."""

from __future__ import annotations

import io
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.robots.ros_names import RosNames
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.deploying import topics as tables
from dextera_build.deploying.bag import ABOUT, SUMMARY, VERDICT, Bag
from dextera_build.deploying.cell import RosCell, Safety
from dextera_build.deploying.demonstration import Demonstration
from dextera_build.deploying.driving import Acting, Clock, Drive, drive, facts
from dextera_build.deploying.loopback import Bus, Loopback
from dextera_build.deploying.simulated import SimulatedRobot, Simulation
from dextera_build.policy.observation import DeployableObservation, Frame, Frames
from dextera_build.sim.runtime.environment import Environment
from tests import factories, task_bundles

TICK_NS = 10_000_000
NEEDED = ("objects", "displacement")


@dataclass
class Line:
    """Moves towards fixed targets; after some steps it does something else."""

    targets: np.ndarray
    after: int = 10**9
    then: Callable[[], np.ndarray] | None = None
    seen: list[DeployableObservation] = field(default_factory=list)

    def reset(self) -> None:
        self.seen.clear()

    def act(self, observation: DeployableObservation) -> np.ndarray:
        self.seen.append(observation)
        if self.then is not None and len(self.seen) > self.after:
            return self.then()
        return self.targets


OVER, AROUND, CLOSED, UP = (
    np.array([0.3, 0.1, 0.1, 0.05, 0.05]),
    np.array([0.3, 0.1, 0.0, 0.05, 0.05]),
    np.array([0.3, 0.1, 0.0, 0.01, 0.01]),
    np.array([0.3, 0.1, 0.16, 0.01, 0.01]),
)
"""Slides of the gantry on the way to a lifted box: x, y, z, left, right [m]."""


@dataclass
class Lifting:
    """Lifts the box, 30 control periods from place to place."""

    places: tuple[np.ndarray, ...] = (OVER, AROUND, CLOSED, UP)
    steps: int = 0

    def reset(self) -> None:
        self.steps = 0

    def act(self, observation: DeployableObservation) -> np.ndarray:
        path = (np.array([0.0, 0.0, 0.0, 0.05, 0.05]), *self.places, self.places[-1])
        leg, done = divmod(min(self.steps, 30 * len(self.places)), 30)
        self.steps += 1
        return np.asarray(path[leg] + (path[leg + 1] - path[leg]) * done / 30)


def recording(
    acting: Acting,
    /,
    *,
    operator: bool | None = None,
    origin: str = "policy",
    limit_s: float = 12.0,
    camera: np.ndarray | None = None,
    needed: tuple[str, ...] = NEEDED,
    simulation: Simulation | None = None,
    thinks: Callable[[], float] = lambda: 0.0,
    **about: str,
) -> bytes:
    """The recording of a run in the simulated robot, with what its camera shows; `about` replaces facts.

    `thinks` says how long each answer of the policy takes [s].
    """
    rig = Rig(out=io.BytesIO(), simulation=simulation, camera=camera, needed=needed)
    rig.sleep(0.1)
    rig.bag.describe(rig.bundle, rig.time)
    said = {"policy": "0" * 64, "algorithm": "line", "origin": origin}
    rig.bag.state(ABOUT, rig.time, facts(rig.cell, rig.bundle) | said | about)
    ran = rig.drive(Shown(acting, lambda: rig.sleep(seconds) if (seconds := thinks()) else None), limit_s)
    rig.bag.state(SUMMARY, rig.time, ran.facts())
    rig.bag.state(VERDICT, rig.time, {"measured": ran.success, "operator": operator})
    kept: list[bytes] = []
    rig.file.close = lambda: kept.append(rig.file.getvalue())
    rig.bag.close()
    return kept[0]


class Watcher:
    """Records a demonstration that another program, a run, commands in the simulated robot.

    Args:
        rig: The robot.
        needed: What is measured besides the joints.
        names: Names in ROS 2.
    """

    def __init__(self, rig: Rig, needed: tuple[str, ...] = NEEDED, names: RosNames | None = None) -> None:
        self._rig, self._file = rig, io.BytesIO()
        self.bag, self.transport = Bag(self._file), Loopback(rig.bus)
        cameras = ("workspace",) if "rgb" in needed else ()
        self.topics = tables.of_robot(rig.bundle.robot, names or RosNames(), cameras)
        self.cell = RosCell(self.transport, self.topics, rig.bundle, needed, bag=self.bag, sleep=rig.sleep)
        self.made = Demonstration(self.transport, self.topics, rig.bundle, self.cell, self.bag)
        about = {"policy": "", "algorithm": "", "origin": "operator", "world": "real"}
        self.bag.state(ABOUT, rig.time, facts(self.cell, rig.bundle) | about)

    def step(self) -> None:
        """Record a control period, once every joint was commanded."""
        if self.made.commanded and not self.made.steps:
            self.made.begin()
        if self.made.commanded and not self.made.success:
            self.made.step()

    def closed(self, reason: str, operator: bool | None = None) -> bytes:
        """The recording."""
        self.made.end(reason)
        self.bag.state(VERDICT, self._rig.time, {"measured": self.made.success, "operator": operator})
        kept: list[bytes] = []
        self._file.close = lambda: kept.append(self._file.getvalue())  # type: ignore[method-assign]
        self.bag.close()
        return kept[0]


@dataclass
class Shown:
    """A policy; a step of something else, as of a `Watcher`, belongs to each control period."""

    policy: Acting
    step: Callable[[], None]

    def reset(self) -> None:
        self.policy.reset()

    def act(self, observation: DeployableObservation) -> np.ndarray:
        self.step()
        return self.policy.act(observation)


def demonstration() -> bytes:
    """The recording of a demonstration that another program, a run, commands in the simulated robot."""
    rig = Rig()
    watcher = Watcher(rig)
    rig.drive(Shown(Lifting(), watcher.step), 12.0)
    while not watcher.made.success and watcher.made.steps < 400:
        rig.sleep(0.05)
        watcher.step()
    return watcher.closed("the operator ended it")


class Rig:
    """A robot, its world, and a cell that is connected to it.

    Args:
        names: Names in ROS 2.
        simulation: The robot's sensors and faults.
        camera: What the camera shows; None: there is none.
        depth: Its depth [m]; None: none is published.
        cell_names: Names that the cell believes.
        look: Gives what the camera shows in a world, instead.
        intrinsics: Intrinsics that the camera publishes.
    """

    def __init__(
        self,
        names: RosNames | None = None,
        simulation: Simulation | None = None,
        *,
        camera: np.ndarray | None = None,
        depth: np.ndarray | None = None,
        needed: tuple[str, ...] = NEEDED,
        safety: Safety | None = None,
        cell_names: RosNames | None = None,
        out: Any = None,
        bundle: TaskBundle | None = None,
        seed: int | None = None,
        look: Callable[[Environment], Frames] | None = None,
        intrinsics: Camera | None = None,
        lenses: Mapping[str, Camera] | None = None,
    ) -> None:
        self.bundle = bundle or task_bundles.lift()
        self.time = 1_000 * 1_000_000_000
        self.bus = Bus(now=lambda: self.time)
        cameras = tuple(lenses or ()) or (() if camera is None and look is None else ("workspace",))
        topics = tables.of_robot(self.bundle.robot, names or RosNames(), cameras)
        world = Environment(self.bundle)
        shown = None if look is None else partial(look, world)
        if camera is not None:
            noisy = lambda: Frame(camera + np.uint8(self.time // TICK_NS % 2), depth)  # noqa: E731
            shown = lambda: {"workspace": noisy()}  # noqa: E731
        if seed is not None:
            world.begin(world.draw(seed))
        simulation = simulation or Simulation()
        self.robot = SimulatedRobot(Loopback(self.bus), topics, world, simulation, shown, intrinsics)
        self.file = io.BytesIO() if out is None else out
        self.bag = Bag(self.file)
        believed = topics if cell_names is None else tables.of_robot(self.bundle.robot, cell_names, cameras)
        self.transport = Loopback(self.bus)
        seen = {} if depth is None else {"workspace": factories.camera(depth.shape[1], depth.shape[0])}
        seen |= lenses or {}
        self.cell = RosCell(
            self.transport, believed, self.bundle, needed, safety or Safety(), self.bag, sleep=self.sleep, lenses=seen
        )

    def sleep(self, seconds: float) -> None:
        """Let time pass, for the robot too."""
        for _ in range(max(1, round(seconds * 1e9) // TICK_NS)):
            self.time += TICK_NS
            self.bus.deliver()
            self.robot.tick()

    def drive(self, policy: Acting, limit_s: float = 2.0, halt: threading.Event | None = None) -> Drive:
        """Run a policy; `halt` is the operator's stop."""
        goal = self.robot.environment.goal
        clock = Clock(lambda: self.time, self.sleep)
        return drive(
            self.cell, policy, goal, rate_hz=self.bundle.task.control_hz, limit_s=limit_s, clock=clock, halt=halt
        )
