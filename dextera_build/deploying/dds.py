"""ROS 2 topics by DDS: what `rmw_cyclonedds` and `rmw_fastrtps` speak, without an installation of ROS 2.

Robots are found by their addresses, without multicast, which many wireless networks lose. Fast DDS describes types in
a way that Cyclone DDS refuses, after which no topic would match; the setting for its vendor, 1.15, makes Cyclone DDS
ignore these descriptions [ros2/rmw_cyclonedds #535].
"""

from __future__ import annotations

import ctypes
import os
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Any
from xml.sax.saxutils import quoteattr

from dextera_build.deploying import delay, idl
from dextera_build.deploying.transport import Endpoint, Quality, Receive, Topic, failed
from dextera_build.errors import MachineError, install_extra
from dextera_build.formats.ros import hashes

LOCAL = "127.0.0.1"
PREFIX = "rt"
"""First part of the DDS names of topics; those of services have other ones."""
MOST_DOMAIN = 232
"""Largest domain whose ports exist."""
WAIT_MS = 100
"""Longest time after which the receiving thread looks whether the transport was closed [ms]."""
_DOMAINS: dict[int, Any] = {}
"""Domains of this process; only the creation of one takes a configuration, and a process has each domain once."""
_TYPES = threading.Lock()
"""Held while a topic is made: cyclonedds registers its type for all participants of the process."""
ACKNOWLEDGED_NS = 200_000_000
"""Longest time in which a transport that is closed waits for its last messages to arrive [ns]."""
BATCH = 32
"""Most messages of one topic that are taken at once."""


def config(peers: Sequence[str]) -> str:
    """Configuration of Cyclone DDS for robots at these addresses."""
    listed = "".join(f"<Peer address={quoteattr(peer)}/>" for peer in dict.fromkeys((LOCAL, *peers)))
    only_here = not set(peers) - {LOCAL, "localhost"}
    interface = f'<Interfaces><NetworkInterface address="{LOCAL}"/></Interfaces>' if only_here else ""
    return (
        f'<CycloneDDS><Domain Id="any"><General>{interface}<AllowMulticast>false</AllowMulticast></General>'
        f"<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>50</MaxAutoParticipantIndex>"
        f"<Peers>{listed}</Peers></Discovery>"
        "<Compatibility><IgnoreTypeInformation>1.15</IgnoreTypeInformation></Compatibility></Domain></CycloneDDS>"
    )


class Dds:
    """A participant of a DDS domain.

    Args:
        peers: Addresses of robots; none: this machine alone. In one process, the first participant of a domain decides.
        domain: `ROS_DOMAIN_ID` of the robot.

    Raises:
        MachineError: cyclonedds is not installed, or cannot use the network.
    """

    def __init__(self, peers: Sequence[str] = (), domain: int = 0) -> None:
        self._api, self._peers = _Api(), tuple(peers) or (LOCAL,)
        # A configuration of the user's own, for another network interface, stays in force.
        settings = os.environ.get("CYCLONEDDS_URI") or config(peers)
        try:
            if domain not in _DOMAINS:
                _DOMAINS[domain] = self._api.domain(domain, settings)
                # Python would delete it at its end, when Cyclone DDS may wait for its own threads for ever.
                ctypes.pythonapi.Py_IncRef(ctypes.py_object(_DOMAINS[domain]))
            self._participant = self._api.participant(domain)
        except self._api.error as error:
            raise MachineError(
                f"no participant of DDS domain {domain} can be made",
                code="DXB-E441",
                facts={"peers": ", ".join(peers) or "this machine", "reason": str(error).strip()},
                hint="check the addresses; set CYCLONEDDS_URI to choose a network interface",
            ) from None
        self._writers: dict[str, Any] = {}
        self._readers: list[tuple[Any, Receive]] = []
        self._topics: dict[str, Any] = {}
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self.fault = ""
        """Why messages were not taken; empty if all were."""
        self._wakes = self._api.waitset(self._participant)
        self._thread = threading.Thread(target=self._listen, name="dds", daemon=True)
        self._thread.start()

    def offer(self, topic: Topic) -> None:
        """Announce a topic that will be published."""
        with self._lock:
            self._writer(topic)

    def publish(self, topic: Topic, message: bytes) -> None:
        """Publish a message (CDR with its encapsulation)."""
        with self._lock:
            self._writer(topic).write(idl.value(topic.kind, message))

    def subscribe(self, topic: Topic, receive: Receive) -> None:
        """Pass every message of a topic to `receive`, in the thread of this transport."""
        with self._lock:
            reader, condition = self._api.reader(self._participant, self._topic(topic), topic)
            self._readers.append((reader, receive))
            self._wakes.attach(condition)

    def clock(self) -> int:
        """Time by which messages are stamped [ns since 1970]."""
        return time.time_ns()

    def fits(self, offered: Quality, requested: Quality) -> bool:
        """Whether a reader that requests a quality gets the messages of a writer that offers one."""
        return offered.admits(requested)

    def others(self) -> tuple[Endpoint, ...]:
        """Writers and readers of other programs that were discovered so far."""
        return self._api.endpoints(self._participant)

    def round_trip_s(self) -> float | None:
        """Longest time to a peer and back [s]; None if one does not answer."""
        return delay.longest_s(self._peers)

    def close(self) -> None:
        """End all topics; nothing is received afterwards."""
        self._closed.set()
        self._thread.join(5)
        with self._lock:
            for writer in self._writers.values():
                # Where nobody acknowledges in time, cyclonedds 11.0.1 looks up its constant in the wrong class.
                with suppress(self._api.error, AttributeError):
                    writer.wait_for_acks(ACKNOWLEDGED_NS)
            self._readers.clear()
            self._writers.clear()
            self._topics.clear()
            self._wakes = self._participant = None

    def _writer(self, topic: Topic) -> Any:
        """The writer of a topic."""
        if topic.name not in self._writers:
            self._writers[topic.name] = self._api.writer(self._participant, self._topic(topic), topic)
        return self._writers[topic.name]

    def _topic(self, topic: Topic) -> Any:
        """The topic of DDS, one for writers and readers."""
        if topic.name not in self._topics:
            with _TYPES:
                self._topics[topic.name] = self._api.topic(self._participant, topic)
        return self._topics[topic.name]

    def _listen(self) -> None:
        """Receive until the transport is closed; what ends it before is told, because nobody would hear of it."""
        try:
            self._receive()
        except Exception as error:
            self.fault = f"messages are received no more: {type(error).__name__}: {error}"

    def _receive(self) -> None:
        while not self._closed.is_set():
            self._wakes.wait(WAIT_MS * 1_000_000)
            with self._lock:
                waiting = [(reader.take(BATCH), receive) for reader, receive in self._readers]
            arrived = time.time_ns()
            for taken, receive in waiting:
                for each in taken:
                    if hasattr(each, "cdr") and not self._closed.is_set():
                        why = failed(receive, each.cdr, arrived)
                        self.fault = self.fault or why


class _Api:
    """The functions of cyclonedds that are used here."""

    def __init__(self) -> None:
        try:
            from cyclonedds import builtin, core, domain, pub, qos, sub, topic
        except ImportError:
            raise MachineError(
                "robots by DDS need cyclonedds, which is not installed", code="DXB-E440", hint=install_extra("ros")
            ) from None
        self._builtin, self._core, self._pub, self._sub, self._topic = builtin, core, pub, sub, topic
        self._policy, self._qos = qos.Policy, qos.Qos
        self.error, self.domain, self.participant = core.DDSException, domain.Domain, domain.DomainParticipant

    def waitset(self, participant: Any) -> Any:
        """Wakes a thread when a message arrives."""
        return self._core.WaitSet(participant)

    def topic(self, participant: Any, topic: Topic) -> Any:
        """The topic under its DDS name, `rt/joint_states`."""
        return self._topic.Topic(participant, PREFIX + topic.name, idl.packed(topic.kind))

    def writer(self, participant: Any, made: Any, topic: Topic) -> Any:
        """A writer, which states the hash of its type: nodes of ROS 2 warn about one that does not."""
        return self._pub.DataWriter(participant, made, qos=self._quality(topic))

    def reader(self, participant: Any, made: Any, topic: Topic) -> tuple[Any, Any]:
        """A reader, and the condition that it has messages."""
        reader = self._sub.DataReader(participant, made, qos=self._quality(topic))
        core = self._core
        anything = core.ViewState.Any | core.InstanceState.Any | core.SampleState.Any
        return reader, core.ReadCondition(reader, anything)

    def endpoints(self, participant: Any) -> tuple[Endpoint, ...]:
        """Writers and readers of other participants."""
        own = participant.guid
        found = []
        for kind, writes in (("BuiltinTopicDcpsPublication", True), ("BuiltinTopicDcpsSubscription", False)):
            reader = self._builtin.BuiltinDataReader(participant, getattr(self._builtin, kind))
            for each in reader.read(1000):
                known = getattr(each, "topic_name", "").startswith(PREFIX + "/")
                if known and each.participant_key != own:
                    found.append(self._endpoint(each, writes))
        return tuple(found)

    def _endpoint(self, each: Any, writes: bool) -> Endpoint:
        policy = self._policy
        reliable = isinstance(each.qos[policy.Reliability], policy.Reliability.Reliable)
        keeps = each.qos[policy.Durability] == policy.Durability.TransientLocal
        told = bytes(getattr(each.qos[policy.Userdata], "data", b"")).decode("ascii", "replace")
        type_hash = next((part[9:] for part in told.split(";") if part.startswith("typehash=")), "")
        name = each.topic_name.removeprefix(PREFIX)
        return Endpoint(name, idl.ros_name(each.type_name), writes, Quality(reliable, keeps), type_hash)

    def _quality(self, topic: Topic) -> Any:
        policy, quality = self._policy, topic.quality
        second = 1_000_000_000
        lasts = () if quality.lifespan_s is None else (policy.Lifespan(round(quality.lifespan_s * second)),)
        return self._qos(
            *lasts,
            policy.Reliability.Reliable(second // 10) if quality.reliable else policy.Reliability.BestEffort,
            policy.Durability.TransientLocal if quality.keeps else policy.Durability.Volatile,
            policy.History.KeepLast(quality.depth),
            policy.Userdata(f"typehash={hashes.type_hash(topic.kind)};".encode()),
        )
