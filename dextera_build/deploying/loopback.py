"""A transport within one process, for tests: messages arrive in the thread that publishes them."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from dextera_build.deploying.transport import Endpoint, Quality, Receive, Topic
from dextera_build.formats.ros import hashes
from dextera_build.formats.ros.reading import SECOND


@dataclass
class Bus:
    """What several transports share."""

    now: Callable[[], int] = time.time_ns
    """Its clock [ns]."""
    members: list[Loopback] = field(default_factory=list)
    delay_s: float = 0.0
    """Time that a message takes [s]; one that takes time arrives by `deliver`."""
    waiting: deque[tuple[int, Callable[[], None]]] = field(default_factory=deque)
    """When each message that is under way arrives [ns], and what it does then."""

    def deliver(self) -> None:
        """Let the messages arrive whose time has come."""
        while self.waiting and self.waiting[0][0] <= self.now():
            self.waiting.popleft()[1]()


class Loopback:
    """A program on a bus.

    Args:
        bus: The bus.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._readers: dict[str, tuple[Topic, list[Receive]]] = {}
        self._writers: dict[str, Topic] = {}
        self._last: dict[str, bytes] = {}
        self.fault = ""
        """Always empty: errors are those of the program that publishes."""
        bus.members.append(self)

    def offer(self, topic: Topic) -> None:
        """Show a topic to the others."""
        self._writers[topic.name] = topic

    def publish(self, topic: Topic, message: bytes) -> None:
        """Pass a message to all other programs that read the topic with a matching quality."""
        self.offer(topic)
        if topic.quality.keeps:
            self._last[topic.name] = message
        for member in [each for each in self._bus.members if each is not self]:
            if self._bus.delay_s:
                at = self._bus.now() + round(self._bus.delay_s * SECOND)
                self._bus.waiting.append((at, partial(member.arrived, topic, message)))
            else:
                member.arrived(topic, message)

    def arrived(self, topic: Topic, message: bytes) -> None:
        """Pass a message of another program to the readers."""
        reader, receivers = self._readers.get(topic.name, (topic, []))
        if reader.kind == topic.kind and topic.quality.admits(reader.quality):
            for receive in list(receivers):
                receive(message, self._bus.now())

    def subscribe(self, topic: Topic, receive: Receive) -> None:
        """Pass every message of a topic to `receive`."""
        self._readers.setdefault(topic.name, (topic, []))[1].append(receive)
        for member in [each for each in self._bus.members if each is not self]:
            kept = member._last.get(topic.name)
            if kept is not None and topic.quality.keeps:
                receive(kept, self._bus.now())

    def clock(self) -> int:
        """Time of the bus [ns]."""
        return self._bus.now()

    def fits(self, offered: Quality, requested: Quality) -> bool:
        """Whether a reader that requests a quality gets the messages of a writer that offers one."""
        return offered.admits(requested)

    def others(self) -> tuple[Endpoint, ...]:
        """Writers and readers of the other programs on the bus."""
        found = []
        for member in [each for each in self._bus.members if each is not self]:
            found += [_endpoint(topic, writes=True) for topic in member._writers.values()]
            found += [_endpoint(topic, writes=False) for topic, _ in member._readers.values()]
        return tuple(found)

    def round_trip_s(self) -> float | None:
        """Twice the delay of the bus [s]."""
        return 2.0 * self._bus.delay_s

    def close(self) -> None:
        """Leave the bus."""
        self._readers.clear()
        if self in self._bus.members:
            self._bus.members.remove(self)


def _endpoint(topic: Topic, *, writes: bool) -> Endpoint:
    return Endpoint(topic.name, topic.kind, writes, topic.quality, hashes.type_hash(topic.kind))
