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
from dextera_build.deploying.plans import Plans
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
        self._plans = Plans(self._names, np.full(len(self._names), np.nan))
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
        return bool(np.isfinite(self._plans.ends).all())

    def waits_for(self) -> str:
        """Which joints were not commanded so far, and on which topics; why the last command was of no use."""
        every = []
        unknown = {name for name, place in zip(self._names, self._plans.ends, strict=True) if np.isnan(place)}
        for controller in self._controllers:
            silent = [name for name in controller.joints if name in unknown]
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
        now, period = self._transport.clock(), round(SECOND / self._cell.rate_hz)
        # As the action of a policy, what is to be reached within a control period.
        targets = self._plans.at(self._there(now) + period)
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
            command = self._joints.commanded(controller, message)
        except wire.UnusableError as error:
            self._unusable = f"a command on {controller.topic.name} cannot be used: {error}"
            return  # its controller refuses it, too
        last = self._cell.state.last
        places = np.full(len(self._names), np.nan) if last is None else np.array(last.value)
        self._plans.follow(command, self._there(arrived), places)

    def _there(self, time: int) -> int:
        """A time here by the robot's clock [ns]."""
        return time - round(self._cell.state.offset_s * SECOND)
