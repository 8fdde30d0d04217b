"""ROS 2 topics by rosbridge: JSON on a web socket, for robots whose DDS or Zenoh cannot be reached.

The protocol is https://github.com/RobotWebTools/rosbridge_suite/blob/ros2/ROSBRIDGE_PROTOCOL.md, version 2. The server
is a node on the robot, which chooses qualities of service that fit. Names of other nodes come from its companion,
rosapi.
"""

from __future__ import annotations

import itertools
import json
import threading
import time
from collections.abc import Mapping
from concurrent.futures import Future
from concurrent.futures import TimeoutError as Late
from contextlib import suppress
from typing import Any

from dextera_build.deploying import delay
from dextera_build.deploying.transport import Endpoint, Quality, Receive, Topic, failed
from dextera_build.errors import MachineError, install_extra
from dextera_build.formats.ros import plain
from dextera_build.formats.ros.types import DEFINITIONS

PORT = 9090
"""Port of a server."""
NODE = "rosbridge_websocket"
"""Beginning of the name of a server's node, which publishes and reads for its clients."""
OPEN_S = 5.0
"""Longest time until the server answers [s]."""
ANSWER_S = 10.0
"""Longest time of an answer of rosapi [s]."""
PICTURES = ("sensor_msgs/CompressedImage", "sensor_msgs/Image")
"""Types of which the server keeps only the newest message for a slow network."""


class Rosbridge:
    """A client of a server of rosbridge.

    Args:
        address: HOST or HOST:PORT, or the whole `ws://...` or `wss://...`.

    Raises:
        MachineError: websockets is not installed, or no server answers.
    """

    def __init__(self, address: str) -> None:
        connect, self._closed_error, refused = _websockets()
        self._address = url(address)
        try:
            # The control loop does not wait for compression; messages of depth are large.
            self._link = connect(self._address, open_timeout=OPEN_S, max_size=None, compression=None)
        except (OSError, TimeoutError, refused) as error:
            raise MachineError(
                f"no server of rosbridge answers at `{self._address}`",
                code="DXB-E446",
                facts={"reason": str(error) or type(error).__name__},
                hint="start it on the robot: `ros2 launch rosbridge_server rosbridge_websocket_launch.xml`; "
                "`--robot HOST:PORT` for another port",
            ) from None
        self._lock = threading.Lock()
        self._writers: set[str] = set()
        self._readers: dict[str, tuple[Topic, list[Receive]]] = {}
        self._numbers = itertools.count(1)
        self._asked: dict[str, Future[Mapping[str, Any]]] = {}
        self._closed = False
        self.fault = ""
        """Why messages were not taken; empty if all were."""
        self._thread = threading.Thread(target=self._listen, name="rosbridge", daemon=True)
        self._thread.start()

    def offer(self, topic: Topic) -> None:
        """Announce a topic that will be published."""
        with self._lock:
            self._advertise(topic)

    def publish(self, topic: Topic, message: bytes) -> None:
        """Publish a message (CDR with its encapsulation); after the end of the connection, nothing happens."""
        fields = plain.plain(topic.kind, message)
        with self._lock:
            self._advertise(topic)
            self._send(op="publish", topic=topic.name, msg=fields)

    def subscribe(self, topic: Topic, receive: Receive) -> None:
        """Pass every message of a topic to `receive`, in the thread of this transport."""
        with self._lock:
            known = self._readers.setdefault(topic.name, (topic, []))
            known[1].append(receive)
            if len(known[1]) == 1:
                length = 1 if topic.kind in PICTURES else topic.quality.depth
                self._send(op="subscribe", topic=topic.name, type=topic.kind, queue_length=length)

    def clock(self) -> int:
        """Time by which messages are stamped [ns since 1970]."""
        return time.time_ns()

    def fits(self, offered: Quality, requested: Quality) -> bool:
        """Always: the server takes the qualities of the others."""
        return True

    def others(self) -> tuple[Endpoint, ...]:
        """Writers and readers of other nodes, of the types that dxb knows; other clients of the server are none.

        Raises:
            MachineError: rosapi does not answer.
        """
        found = self._ask("topics", "Topics")
        kinds = zip(found["topics"], found["types"], strict=True)
        every = []
        for name, kind in ((name, kind.replace("/msg/", "/")) for name, kind in kinds):
            if kind not in DEFINITIONS:
                continue
            for service, field, writes in (("Publishers", "publishers", True), ("Subscribers", "subscribers", False)):
                nodes = self._ask(field, service, topic=name)[field]
                others = [node for node in nodes if not node.rpartition("/")[2].startswith(NODE)]
                every += [Endpoint(name, kind, writes, None) for _ in others]
        return tuple(every)

    def round_trip_s(self) -> float | None:
        """Time to the server and back [s], the median of some; None if it does not answer."""
        times = []
        for _ in range(delay.TIMES):
            begun = time.perf_counter()
            with suppress(self._closed_error):
                if self._link.ping().wait(delay.WAIT_S):
                    times.append(time.perf_counter() - begun)
        return sorted(times)[len(times) // 2] if times else None

    def close(self) -> None:
        """End all topics; nothing is received afterwards."""
        self._closed = True
        self._link.close()
        self._thread.join(OPEN_S)

    def _advertise(self, topic: Topic) -> None:
        if topic.name not in self._writers:
            self._writers.add(topic.name)
            latch, length = topic.quality.keeps, topic.quality.depth
            self._send(op="advertise", topic=topic.name, type=topic.kind, latch=latch, queue_size=length)

    def _send(self, **fields: Any) -> None:
        with suppress(self._closed_error):
            self._link.send(json.dumps(fields))

    def _ask(self, service: str, kind: str, **args: Any) -> Mapping[str, Any]:
        """What a service of rosapi answers.

        Raises:
            MachineError: It does not answer.
        """
        number, answer = f"dxb-{next(self._numbers)}", Future[Mapping[str, Any]]()
        self._asked[number] = answer
        name, form = f"/rosapi/{service}", f"rosapi_msgs/srv/{kind}"
        with self._lock:
            self._send(op="call_service", id=number, service=name, type=form, args=args)
        try:
            told = answer.result(ANSWER_S)
        except Late:
            told = {"result": False, "values": f"no answer in {ANSWER_S:g} s"}
        if not told.get("result", True) or not isinstance(told.get("values"), Mapping):
            raise MachineError(
                f"the server at `{self._address}` does not say which nodes there are",
                code="DXB-E447",
                facts={"service": name, "answer": str(told.get("values"))},
                hint="start rosapi, too: `ros2 launch rosbridge_server rosbridge_websocket_launch.xml` starts both",
            )
        return dict(told["values"])

    def _listen(self) -> None:
        """Receive until the connection ends."""
        with suppress(self._closed_error):
            while True:
                text = self._link.recv()
                arrived = time.time_ns()
                with suppress(ValueError):  # no JSON
                    self._arrived(json.loads(text), arrived)

    def _arrived(self, told: Any, arrived: int) -> None:
        if not isinstance(told, dict) or self._closed:
            return
        if told.get("op") == "service_response" and (asked := self._asked.pop(str(told.get("id")), None)):
            asked.set_result(told)
        if told.get("op") != "publish" or told.get("topic") not in self._readers:
            return
        topic, receivers = self._readers[told["topic"]]
        try:
            message = plain.message(topic.kind, told.get("msg"))
        except ValueError:
            message = b""  # who reads it says that it is damaged
        for receive in list(receivers):
            why = failed(receive, message, arrived)
            self.fault = self.fault or why


def url(address: str) -> str:
    """The address of a server."""
    if address.startswith(("ws://", "wss://")):
        return address
    return f"ws://{address}" if address.rpartition(":")[2].isdigit() else f"ws://{address}:{PORT}"


def _websockets() -> tuple[Any, Any, Any]:
    """What opens web sockets, what tells that one ended, and what tells that none opened."""
    try:
        from websockets.exceptions import ConnectionClosed, InvalidHandshake
        from websockets.sync.client import connect
    except ImportError:
        raise MachineError(
            "robots by rosbridge need websockets, which is not installed", code="DXB-E440", hint=install_extra("serve")
        ) from None
    return connect, ConnectionClosed, InvalidHandshake
