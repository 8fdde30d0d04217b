"""The interface of transports: topics with messages as CDR bytes, and what other programs publish or read.

A message is not unpacked by a transport, so that a picture costs no more than its copy.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

Receive = Callable[[bytes, int], None]
"""Takes a message (CDR with its encapsulation) and the time of its arrival [ns], in a thread of the transport."""


@dataclass(frozen=True)
class Quality:
    """Quality of service of a topic, https://design.ros2.org/articles/qos.html."""

    reliable: bool = True
    """Whether lost messages are sent again."""
    keeps: bool = False
    """Whether a reader that comes later gets the last message: `transient local`."""
    depth: int = 10
    """Number of messages that a queue holds."""
    lifespan_s: float | None = None
    """Time after which a message that could not be delivered is no longer sent again [s]; None: never. Of writers."""

    def admits(self, reader: Quality) -> bool:
        """Whether a reader of this quality gets the messages of a writer with the present one."""
        return (self.reliable or not reader.reliable) and (self.keeps or not reader.keeps)

    def __str__(self) -> str:
        return ("reliable" if self.reliable else "best effort") + (", transient local" if self.keeps else "")


SENSOR = Quality(reliable=False, depth=20)
"""A reader of cameras and encoders: it accepts reliable and best-effort writers."""


@dataclass(frozen=True)
class Topic:
    """A topic of ROS 2."""

    name: str
    """`/joint_states`."""
    kind: str
    """Type of its messages, `sensor_msgs/JointState`."""
    quality: Quality = Quality()
    """Quality offered by a writer, or requested by a reader."""


@dataclass(frozen=True)
class Endpoint:
    """A writer or reader of another program."""

    topic: str
    """`/joint_states`."""
    kind: str
    """`sensor_msgs/JointState`; the name of a DDS type if it is none of ROS 2."""
    writes: bool
    """Whether it is a writer."""
    quality: Quality | None
    """Its quality of service; None: it is not stated, because a bridge takes one that fits."""
    type_hash: str = ""
    """`RIHS01_...`; empty if it states none, as programs before ROS 2 Iron."""


def failed(receive: Receive, message: bytes, arrived: int) -> str:
    """Pass a message; why that failed, empty if it did not: an error must not end the thread of a transport."""
    try:
        receive(message, arrived)
    except Exception as error:
        return f"a message could not be taken: {type(error).__name__}: {error}"
    return ""


class Transport(Protocol):
    """Publishes and receives messages."""

    fault: str
    """Why messages were not taken; empty if all were."""

    def offer(self, topic: Topic) -> None:
        """Announce a topic that will be published, so that its readers know of it before the first message."""
        ...

    def publish(self, topic: Topic, message: bytes) -> None:
        """Publish a message (CDR with its encapsulation)."""
        ...

    def subscribe(self, topic: Topic, receive: Receive) -> None:
        """Pass every message of a topic to `receive`."""
        ...

    def clock(self) -> int:
        """Time by which messages are stamped [ns since 1970]."""
        ...

    def fits(self, offered: Quality, requested: Quality) -> bool:
        """Whether a reader that requests a quality gets the messages of a writer that offers one."""
        ...

    def others(self) -> tuple[Endpoint, ...]:
        """Writers and readers of other programs that were discovered so far."""
        ...

    def round_trip_s(self) -> float | None:
        """Time of a message to the robot and back [s]; None: it cannot be measured. It may take seconds."""
        ...

    def close(self) -> None:
        """End all topics; nothing is received afterwards."""
        ...
