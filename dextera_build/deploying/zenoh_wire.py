"""ROS 2 topics by Zenoh, as `rmw_zenoh_cpp` names and announces them, without an installation of ROS 2.

Keys, tokens and qualities are those of https://github.com/ros2/rmw_zenoh, docs/design.md, from ROS 2 Jazzy on. A
router runs on the robot, `rmw_zenohd`, and dxb connects to it as a client, so that nothing listens here.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import struct
import threading
import time
from typing import Any

from dextera_build.deploying import delay
from dextera_build.deploying.idl import dds_name, ros_name
from dextera_build.deploying.transport import Endpoint, Quality, Receive, Topic, failed
from dextera_build.errors import MachineError, install_extra
from dextera_build.formats.ros import hashes

PORT = 7447
"""Port of a router."""
NODE = "dxb"
"""Name of this program in the graph of ROS 2."""
FEW = 10
"""Number of messages that a token without one states."""


class Zenoh:
    """A node of ROS 2 at a router.

    Args:
        address: HOST or HOST:PORT of the robot's router; with `routes`, where this program listens as a router.
        domain: `ROS_DOMAIN_ID` of the robot.
        routes: Whether this program is the router, as a simulated robot is.

    Raises:
        MachineError: eclipse-zenoh is not installed, or there is no router.
    """

    def __init__(self, address: str, domain: int = 0, *, routes: bool = False) -> None:
        self._zenoh, self._ext = _modules()
        endpoint = f"tcp/{address}" if address.rpartition(":")[2].isdigit() else f"tcp/{address}:{PORT}"
        self._endpoint = endpoint
        try:
            self._session = self._zenoh.open(_config(self._zenoh, endpoint, routes))
        except self._zenoh.ZError as error:
            raise MachineError(
                f"no Zenoh router {'can listen' if routes else 'answers'} at `{endpoint}`",
                code="DXB-E443",
                facts={"reason": str(error).partition(" at ")[0]},
                hint="another router runs there: end it, or take its address"
                if routes
                else "start it on the robot: `ros2 run rmw_zenoh_cpp rmw_zenohd`; `--robot HOST:PORT` for another port",
            ) from None
        self._domain, self._zid = domain, str(self._session.info.zid())
        self._lock = threading.Lock()
        self._closed = False
        self.fault = ""
        """Why messages were not taken; empty if all were."""
        self._numbers = itertools.count(1)
        self._writers: dict[str, _Writer] = {}
        self._kept: list[Any] = []
        """Tokens and subscribers, which end with their objects."""
        self._others: dict[str, Endpoint] = {}
        self._announce("NN", 0, "")
        self._kept.append(
            self._session.liveliness().declare_subscriber(f"@ros2_lv/{domain}/**", self._seen, history=True)
        )

    def offer(self, topic: Topic) -> None:
        """Announce a topic that will be published."""
        with self._lock:
            self._offered(topic)

    def publish(self, topic: Topic, message: bytes) -> None:
        """Publish a message (CDR with its encapsulation)."""
        with self._lock:
            self._offered(topic).put(message)

    def subscribe(self, topic: Topic, receive: Receive) -> None:
        """Pass every message of a topic to `receive`, in a thread of Zenoh."""

        def arrived(sample: Any) -> None:
            if not self._closed:
                why = failed(receive, sample.payload.to_bytes(), time.time_ns())
                self.fault = self.fault or why

        # A type with another hash arrives, too, as by DDS; `robot doctor` names it.
        key = f"{self._key(topic)}/*"
        with self._lock:
            if topic.quality.keeps:
                kept = self._ext.HistoryConfig(detect_late_publishers=True, max_samples=topic.quality.depth)
                made = self._ext.declare_advanced_subscriber(self._session, key, arrived, history=kept)
            else:
                made = self._session.declare_subscriber(key, arrived)
            self._kept.append(made)
            self._announce("MS", next(self._numbers), _described(topic))

    def clock(self) -> int:
        """Time by which messages are stamped [ns since 1970]."""
        return time.time_ns()

    def fits(self, offered: Quality, requested: Quality) -> bool:
        """Always: Zenoh has no qualities that keep a writer from a reader."""
        return True

    def others(self) -> tuple[Endpoint, ...]:
        """Writers and readers of other programs that were discovered so far."""
        with self._lock:
            return tuple(self._others.values())

    def round_trip_s(self) -> float | None:
        """Time to the router and back [s]; None if it does not answer."""
        host, _, port = self._endpoint.removeprefix("tcp/").rpartition(":")
        return delay.round_trip_s(host, (int(port),))

    def close(self) -> None:
        """End all topics; nothing is received afterwards."""
        self._closed = True
        with self._lock:
            self._writers.clear()
            self._kept.clear()
        self._session.close()

    def _key(self, topic: Topic) -> str:
        return f"{self._domain}/{topic.name.strip('/')}/{dds_name(topic.kind)}"

    def _offered(self, topic: Topic) -> _Writer:
        if topic.name not in self._writers:
            self._writers[topic.name] = self._writer(topic)
        return self._writers[topic.name]

    def _writer(self, topic: Topic) -> _Writer:
        quality, zenoh = topic.quality, self._zenoh
        options = {
            # As rmw_zenoh: a slow network loses messages and never holds up the control loop.
            "congestion_control": zenoh.CongestionControl.DROP,
            "reliability": zenoh.Reliability.RELIABLE if quality.reliable else zenoh.Reliability.BEST_EFFORT,
        }
        key = f"{self._key(topic)}/{hashes.type_hash(topic.kind)}"
        if quality.keeps:
            cache = self._ext.CacheConfig(max_samples=quality.depth)
            made = self._ext.declare_advanced_publisher(
                self._session, key, cache=cache, publisher_detection=True, **options
            )
        else:
            made = self._session.declare_publisher(key, **options)
        token = self._announce("MP", next(self._numbers), _described(topic))
        return _Writer(made, hashlib.blake2b(token.encode(), digest_size=16).digest())

    def _announce(self, kind: str, number: int, described: str) -> str:
        """Show the node, a writer or a reader to others; returns its token's key."""
        key = f"@ros2_lv/{self._domain}/{self._zid}/0/{number}/{kind}/%/%/{NODE}{described}"
        self._kept.append(self._session.liveliness().declare_token(key))
        return key

    def _seen(self, sample: Any) -> None:
        """A token of another program came or went."""
        key = str(sample.key_expr)
        found = endpoint(key)
        if found is None or key.split("/")[2] == self._zid:
            return
        with self._lock:
            if sample.kind == self._zenoh.SampleKind.PUT:
                self._others[key] = found
            else:
                self._others.pop(key, None)


class _Writer:
    """Publishes the messages of one topic with the numbers that nodes of ROS 2 expect.

    Args:
        publisher: Of Zenoh.
        gid: 16 bytes that tell it from other writers.
    """

    def __init__(self, publisher: Any, gid: bytes) -> None:
        self._publisher, self._gid, self._numbers = publisher, gid, itertools.count(1)

    def put(self, message: bytes) -> None:
        """Publish."""
        attached = struct.pack("<qqB16s", next(self._numbers), time.time_ns(), 16, self._gid)
        self._publisher.put(message, attachment=attached)


def endpoint(token: str) -> Endpoint | None:
    """The writer or reader that a liveliness token announces; None for a node, a service, or another form."""
    parts = token.split("/")
    if len(parts) != 13 or parts[5] not in ("MP", "MS"):
        return None
    name, kind, type_hash, told = parts[9:]
    fields = told.split(":")
    if len(fields) != 6:
        return None
    depth = fields[2].partition(",")[2]
    quality = Quality(fields[0] != "2", fields[1] == "1", int(depth) if depth.isdigit() else FEW)
    return Endpoint(name.replace("%", "/"), ros_name(kind), parts[5] == "MP", quality, type_hash)


def _described(topic: Topic) -> str:
    """The part of a token about a topic: name, type, hash, and quality as numbers of rmw, empty where default."""
    quality = topic.quality
    told = f"{'' if quality.reliable else 2}:{1 if quality.keeps else ''}:,{quality.depth}:,:,:,,"
    return f"/{topic.name.replace('/', '%')}/{dds_name(topic.kind)}/{hashes.type_hash(topic.kind)}/{told}"


def _config(zenoh: Any, endpoint: str, routes: bool) -> Any:
    """A session that reaches, or opens, one address; the user's own if `ZENOH_SESSION_CONFIG_URI` names a file."""
    path = os.environ.get("ZENOH_SESSION_CONFIG_URI")
    config = zenoh.Config.from_file(path) if path else zenoh.Config()
    settings = {
        "mode": "router" if routes else "client",
        "listen/endpoints": [endpoint] if routes else [],
        "connect/endpoints": [] if routes else [endpoint],
        "scouting/multicast/enabled": False,
        # Caches of kept messages order them by time.
        "timestamping/enabled": True,
    }
    for name, value in settings.items():
        config.insert_json5(name, json.dumps(value))
    return config


def _modules() -> tuple[Any, Any]:
    try:
        import zenoh
        import zenoh.ext
    except ImportError:
        raise MachineError(
            "robots by Zenoh need eclipse-zenoh, which is not installed", code="DXB-E440", hint=install_extra("zenoh")
        ) from None
    return zenoh, zenoh.ext
