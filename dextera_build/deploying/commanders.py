"""Notices another program that commands the same joints: a robot would follow both in turn.

Commands of this program come back from most transports. Everything else that arrives on the topic of a controller
after the first command was sent is of another program. Goals that a program sends by an action are not seen.
"""

from __future__ import annotations

from functools import partial

from dextera_build.deploying import wire
from dextera_build.deploying.topics import Commanded, Topics
from dextera_build.deploying.transport import SENSOR, Topic, Transport

KEPT = 1000
"""Number of own commands that are known; the last ones come back within a second or so."""


class Commanders:
    """Reads the topics of a robot's controllers.

    Args:
        transport: Carries the messages.
        topics: Topics of the robot.
        joints: Reads commands.
    """

    def __init__(self, transport: Transport, topics: Topics, joints: wire.Joints) -> None:
        self._transport, self._topics, self._joints = transport, topics, joints
        # In a dictionary, because the thread of the transport looks while another command is noted.
        self._own = dict[object, None]()
        self._listens = False
        self.fault = ""
        """Who else commands; empty if nobody does."""

    def sends(self, controller: Commanded, message: bytes) -> None:
        """Note a command before it is sent; the first one begins to listen."""
        self._own[self._read(controller, message)] = None
        if len(self._own) > KEPT:
            del self._own[next(iter(self._own))]
        if not self._listens:
            self._listens = True
            for each in self._topics.controllers:
                read = Topic(each.topic.name, each.topic.kind, SENSOR)
                self._transport.subscribe(read, partial(self._heard, each))

    def _heard(self, controller: Commanded, message: bytes, arrived: int) -> None:
        if self._read(controller, message) not in self._own:
            self.fault = self.fault or f"another program commands {controller.topic.name}, too"

    def _read(self, controller: Commanded, message: bytes) -> object:
        """What a command says, whatever the transport did to its bytes; the bytes of one that says nothing."""
        try:
            return self._joints.commanded(controller, message)
        except wire.UnusableError:
            return message
