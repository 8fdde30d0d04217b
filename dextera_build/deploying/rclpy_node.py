"""A node of ROS 2 for `rclpy_wire`, run by the Python of an installation of ROS 2: `rclpy_node.py DOMAIN`.

It imports nothing of dxb, and rclpy only when it runs. Frames on stdin and stdout are a letter, a number in four bytes,
the length in four bytes, and that many bytes. It reads `O` (offer) and `S` (subscribe) with a topic as JSON, `P`
(publish) with a message, and `Q` (who else is there); it writes `M` with a message, `E` with the endpoints as JSON, `R`
when it is ready, and `F` with a fault. Numbers are those of the topics; messages are CDR with their encapsulation.
"""

from __future__ import annotations

import importlib
import json
import os
import struct
import sys
import threading
from contextlib import suppress
from typing import Any, BinaryIO

HEAD = struct.Struct("<cII")
"""Letter, number and length of a frame."""


class Pipe:
    """Frames to the parent.

    Args:
        file: Where they go.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file, self._lock = file, threading.Lock()

    def put(self, letter: bytes, number: int, data: bytes) -> None:
        """Write a frame."""
        with self._lock:
            self._file.write(HEAD.pack(letter, number, len(data)) + data)
            self._file.flush()


def quality(stated: Any) -> Any:
    """A profile of rclpy."""
    from rclpy import duration, qos  # type: ignore[import-not-found]

    lasts, reliable, keeps = stated["lifespan_s"], qos.ReliabilityPolicy, qos.DurabilityPolicy
    return qos.QoSProfile(
        depth=stated["depth"],
        reliability=reliable.RELIABLE if stated["reliable"] else reliable.BEST_EFFORT,
        durability=keeps.TRANSIENT_LOCAL if stated["keeps"] else keeps.VOLATILE,
        **({} if lasts is None else {"lifespan": duration.Duration(seconds=lasts)}),
    )


def kind(name: str) -> Any:
    """The class of `sensor_msgs/JointState`."""
    package, _, message = name.partition("/")
    return getattr(importlib.import_module(f"{package}.msg"), message)


def endpoints(node: Any) -> list[dict[str, Any]]:
    """Writers and readers of the other nodes."""
    found = []
    for topic, _ in node.get_topic_names_and_types():
        for writes, infos in (
            (True, node.get_publishers_info_by_topic(topic)),
            (False, node.get_subscriptions_info_by_topic(topic)),
        ):
            found += [endpoint(topic, writes, each) for each in infos if each.node_name != node.get_name()]
    return found


def endpoint(topic: str, writes: bool, info: Any) -> dict[str, Any]:
    """One of them; ROS 2 before Iron states no hash of its type."""
    profile, hashed = info.qos_profile, getattr(info, "topic_type_hash", None)
    stated = f"RIHS{hashed.version:02d}_{bytes(hashed.value).hex()}" if hashed and hashed.version > 0 else ""
    return {
        "topic": topic,
        "kind": info.topic_type.replace("/msg/", "/"),
        "writes": writes,
        "reliable": profile.reliability.name == "RELIABLE",
        "keeps": profile.durability.name == "TRANSIENT_LOCAL",
        "type_hash": stated,
    }


def read(node: Any, pipe: Pipe, number: int, stated: Any) -> None:
    """Read a topic; one whose type is not installed stays silent, which stops only what needs it."""
    try:
        made = kind(stated["kind"])
    except (ImportError, AttributeError):
        print(f"`{stated['name']}` is not read: `{stated['kind']}` is not installed", file=sys.stderr, flush=True)
        return
    put = lambda message: pipe.put(b"M", number, bytes(message))  # noqa: E731
    node.create_subscription(made, stated["name"], put, quality(stated), raw=True)


def obey(node: Any, pipe: Pipe, file: BinaryIO) -> None:
    """Do what the frames of the parent say, until it ends."""
    writers: dict[int, Any] = {}
    while len(head := file.read(HEAD.size)) == HEAD.size:
        letter, number, length = HEAD.unpack(head)
        data = file.read(length)
        try:
            if letter == b"P":
                writers[number].publish(data)
            elif letter == b"O":
                stated = json.loads(data)
                writers[number] = node.create_publisher(kind(stated["kind"]), stated["name"], quality(stated))
            elif letter == b"S":
                read(node, pipe, number, json.loads(data))
            elif letter == b"Q":
                pipe.put(b"E", 0, json.dumps(endpoints(node)).encode())
        except Exception as error:  # the parent tells it
            pipe.put(b"F", number, f"{type(error).__name__}: {error}".encode())


def main(domain: int) -> None:
    """Be a node until the parent ends."""
    import rclpy

    pipe = Pipe(os.fdopen(os.dup(1), "wb"))
    os.dup2(2, 1)  # what libraries print is no frame
    rclpy.init(domain_id=domain)
    node = rclpy.create_node(f"dxb_{os.getpid()}")
    pipe.put(b"R", 0, b"")

    def follow() -> None:
        obey(node, pipe, sys.stdin.buffer)
        rclpy.try_shutdown()

    threading.Thread(target=follow, daemon=True).start()
    with suppress(rclpy.executors.ExternalShutdownException):
        rclpy.spin(node)


if __name__ == "__main__":
    main(int(sys.argv[1]))
