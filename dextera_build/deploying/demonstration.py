"""Records a demonstration that another program commands: nothing is sent, measurements and commands are written.

The other program may be any that moves the robot by its controllers: the vendor's teleoperation, a leader arm, or a
script.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.deploying import periods, wire
from dextera_build.deploying.bag import Bag
from dextera_build.deploying.cell import RosCell
from dextera_build.deploying.topics import STATUS, Commanded, Topics
from dextera_build.deploying.transport import Transport
from dextera_build.errors import listing
from dextera_build.formats.ros.reading import SECOND
from dextera_build.policy.robot_run import REQUESTED, SENT, STOPPED


class Demonstration:
    """One demonstration.

    Args:
        transport: Carries the messages.
        topics: Topics of the robot.
        bundle: The task in the twin.
        cell: Measures the robot.
        bag: Recording.
    """

    def __init__(self, transport: Transport, topics: Topics, bundle: TaskBundle, cell: RosCell, bag: Bag) -> None:
        self._transport, self._bundle, self._cell, self._bag = transport, bundle, cell, bag
        self._names = [joint.name for joint in bundle.robot.joints]
        self._joints = wire.Joints(self._names, topics)
        self._targets = np.full(len(self._names), np.nan)
        self._controllers, self._unusable = topics.controllers, ""
        self.steps = 0
        """Number of control periods that were recorded."""
        self.success: bool | None = None
        """Whether the measurements show success; None: objects are not measured."""
        for controller in topics.controllers:
            transport.subscribe(controller.topic, partial(self._heard, controller))

    @property
    def commanded(self) -> bool:
        """Whether every joint was commanded."""
        return bool(np.isfinite(self._targets).all())

    def waits_for(self) -> str:
        """Which joints were not commanded so far, and on which topics; why the last command was of no use."""
        every = []
        for controller in self._controllers:
            silent = [name for name in controller.joints if np.isnan(self._targets[self._names.index(name)])]
            every += [f"{listing(silent)} on {controller.topic.name}"] if silent else []
        return "; ".join(filter(None, (*every, self._unusable)))

    def begin(self) -> None:
        """Begin, once every joint was commanded.

        Raises:
            Stopped: A topic stays silent, or what it says cannot be used.
        """
        self._cell.begin()
        self.success = False if self._cell.judges else None

    def step(self) -> None:
        """Record one control period.

        Raises:
            Stopped: A measurement is missing, too old, or belongs to no other.
        """
        measured = self._cell.measure()
        now, targets = self._transport.clock(), self._targets.copy()
        period = round(SECOND / self._cell.rate_hz)
        periods.commanded(self._bag, now, self._bundle, period, {REQUESTED: targets, SENT: targets})
        if self.steps:
            self.success = self.success or self._cell.judge(measured, self.steps / self._cell.rate_hz)
        self.steps += 1

    def end(self, reason: str) -> None:
        """Record why it ended."""
        self._bag.say(STATUS, self._transport.clock(), STOPPED + reason)

    def _heard(self, controller: Commanded, message: bytes, arrived: int) -> None:
        self._bag.add(controller.topic, arrived, message)
        try:
            targets, _, _ = self._joints.commanded(controller, message)
        except wire.UnusableError as error:
            self._unusable = f"a command on {controller.topic.name} cannot be used: {error}"
            return  # its controller refuses it, too
        # A new array, because another thread reads the old one.
        fresh = self._targets.copy()
        fresh[[self._names.index(name) for name in targets]] = list(targets.values())
        self._targets = fresh
