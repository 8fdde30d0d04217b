"""ROS 2 topics by rclpy, in a process of the Python of ROS 2: whatever middleware and settings the installation has.

dxb's own Python needs nothing of ROS 2. Messages pass as their CDR bytes in both directions.
"""

from __future__ import annotations

import json
import os
import queue
import subprocess
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from dextera_build.deploying import delay
from dextera_build.deploying.rclpy_node import HEAD
from dextera_build.deploying.transport import Endpoint, Quality, Receive, Topic, failed
from dextera_build.errors import MachineError

PYTHON = "DXB_ROS_PYTHON"
"""Environment variable that names a Python with rclpy."""
START_S = 60.0
"""Longest time until the node is ready [s]; importing rclpy takes seconds on a busy machine."""
ANSWER_S = 10.0
"""Longest time until it tells who else is there [s]."""
END_S = 5.0
"""Longest time until it has ended [s]."""
HERE = ("127.0.0.1", "localhost")


class Rclpy:
    """A node in a process of its own.

    Args:
        peers: Addresses of robots; none: this machine alone.
        domain: `ROS_DOMAIN_ID` of the robot.

    Raises:
        MachineError: That Python has no rclpy, or the node does not start.
    """

    def __init__(self, peers: Sequence[str] = (), domain: int = 0) -> None:
        self._peers = tuple(peers) or HERE[:1]
        python = os.environ.get(PYTHON) or "python3"
        command = [python, str(Path(__file__).with_name("rclpy_node.py")), str(domain)]
        self.fault, self._closed = "", False
        self._lock = threading.Lock()
        self._writers: dict[str, int] = {}
        self._readers: dict[int, Receive] = {}
        self._answers: queue.Queue[bytes] = queue.Queue()
        self._ready = threading.Event()
        try:
            self._process = subprocess.Popen(
                command,
                env=_environment(self._peers),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,
            )
        except OSError as error:
            raise _unusable(python, str(error)) from None
        self._thread = threading.Thread(target=self._listen, name="rclpy", daemon=True)
        self._thread.start()
        if not self._ready.wait(START_S) or self.fault:
            self.close()
            raise _unusable(python, "the node did not start; what it said is above")

    @property
    def process_id(self) -> int:
        """Of the node's process."""
        return self._process.pid

    def offer(self, topic: Topic) -> None:
        """Announce a topic that will be published."""
        with self._lock:
            self._writer(topic)

    def publish(self, topic: Topic, message: bytes) -> None:
        """Publish a message (CDR with its encapsulation).

        Raises:
            MachineError: The node has ended, or cannot publish it.
        """
        with self._lock:
            self._put(b"P", self._writer(topic), message)

    def subscribe(self, topic: Topic, receive: Receive) -> None:
        """Pass every message of a topic to `receive`, in the thread of this transport."""
        with self._lock:
            number = len(self._readers)
            self._readers[number] = receive
            self._put(b"S", number, _stated(topic))

    def clock(self) -> int:
        """Time by which messages are stamped [ns since 1970]."""
        return time.time_ns()

    def fits(self, offered: Quality, requested: Quality) -> bool:
        """Whether a reader that requests a quality gets the messages of a writer that offers one."""
        return offered.admits(requested)

    def others(self) -> tuple[Endpoint, ...]:
        """Writers and readers of other nodes that were discovered so far.

        Raises:
            MachineError: The node has ended, or does not answer.
        """
        with self._lock:
            self._put(b"Q", 0, b"")
        try:
            found: list[dict[str, Any]] = json.loads(self._answers.get(timeout=ANSWER_S))
        except queue.Empty:
            raise self._ended("it does not answer") from None
        return tuple(
            Endpoint(
                each["topic"],
                each["kind"],
                each["writes"],
                Quality(each["reliable"], each["keeps"]),
                each["type_hash"],
            )
            for each in found
        )

    def round_trip_s(self) -> float | None:
        """Longest time to a peer and back [s]; None if one does not answer."""
        return delay.longest_s(self._peers)

    def close(self) -> None:
        """End the node; nothing is received afterwards."""
        self._closed = True
        stdin = self._process.stdin
        assert stdin is not None
        try:
            stdin.close()  # after which the node sends what is left, and ends
            self._process.wait(END_S)
        except (OSError, subprocess.TimeoutExpired):
            self._process.kill()
            self._process.wait()
        self._thread.join(END_S)

    def _writer(self, topic: Topic) -> int:
        if topic.name not in self._writers:
            number = self._writers[topic.name] = len(self._writers)
            self._put(b"O", number, _stated(topic))
        return self._writers[topic.name]

    def _put(self, letter: bytes, number: int, data: bytes) -> None:
        stdin = self._process.stdin
        assert stdin is not None
        if self.fault:
            raise self._ended(self.fault)
        try:
            stdin.write(HEAD.pack(letter, number, len(data)) + data)
            stdin.flush()
        except (OSError, ValueError) as error:
            raise self._ended(str(error)) from None

    def _listen(self) -> None:
        """Receive until the node ends."""
        out = self._process.stdout
        assert out is not None
        while len(head := out.read(HEAD.size)) == HEAD.size:
            letter, number, length = HEAD.unpack(head)
            data, arrived = out.read(length), time.time_ns()
            if letter == b"M" and not self._closed:
                self.fault = self.fault or failed(self._readers[number], data, arrived)
            elif letter == b"E":
                self._answers.put(data)
            elif letter == b"F":
                self.fault = data.decode("utf-8", "replace")
            elif letter == b"R":
                self._ready.set()
        self.fault = self.fault or "its process has ended"
        self._ready.set()

    def _ended(self, why: str) -> MachineError:
        return MachineError(
            f"the node of rclpy cannot go on: {why}",
            code="DXB-E451",
            hint="see what it said above; `--transport dds` needs no installation of ROS 2",
        )


def _stated(topic: Topic) -> bytes:
    return json.dumps({"name": topic.name, "kind": topic.kind, **asdict(topic.quality)}).encode()


def _environment(peers: Sequence[str]) -> dict[str, str]:
    """Variables of the node: those of this process, and the robot's address where none are set."""
    found = dict(os.environ)
    away = [peer for peer in peers if peer not in HERE]
    if away:
        found.setdefault("ROS_STATIC_PEERS", ";".join(away))
    else:
        found.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    return found


def _unusable(python: str, why: str) -> MachineError:
    return MachineError(
        f"`{python}` cannot run a node of rclpy",
        code="DXB-E450",
        facts={"reason": why},
        hint=f"source the `setup.bash` of ROS 2 in this terminal, or name a Python with rclpy in {PYTHON}",
    )
