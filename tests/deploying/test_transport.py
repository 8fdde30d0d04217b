"""Messages arrive as they were sent, from this process and from a node of ROS 2."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from dextera_build.deploying import delay, loopback
from dextera_build.deploying.topics import STATUS
from dextera_build.deploying.transport import SENSOR, Endpoint, Quality, Topic, Transport
from dextera_build.errors import MachineError
from dextera_build.formats.ros import hashes, messages, types
from tests.readers import ENVIRONMENTS
from tests.remotes.servers import free_port

JOINTS = Topic("/joint_states", "sensor_msgs/JointState")
PICTURES = Topic("/camera/image/compressed", "sensor_msgs/CompressedImage", SENSOR)
DOMAIN = 20 + os.getpid() % 80
"""Tests of several processes at the same time do not meet."""


def until(condition: Callable[[], bool], seconds: float = 10.0) -> None:
    """Wait until a condition holds."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "nothing came"
        time.sleep(0.01)


def pair(kind: str) -> tuple[Transport, Transport]:
    if kind == "loopback":
        bus = loopback.Bus()
        return loopback.Loopback(bus), loopback.Loopback(bus)
    if kind == "zenoh":
        pytest.importorskip("zenoh", reason="needs eclipse-zenoh (extra `zenoh`)")
        from dextera_build.deploying.zenoh_wire import Zenoh

        address = f"127.0.0.1:{free_port()}"
        return Zenoh(address, DOMAIN, routes=True), Zenoh(address, DOMAIN)
    pytest.importorskip("cyclonedds", reason="needs cyclonedds (extra `ros`)")
    from dextera_build.deploying.dds import Dds

    return Dds(domain=DOMAIN), Dds(domain=DOMAIN)


@pytest.fixture(params=["loopback", "dds", "zenoh"])
def both(request: pytest.FixtureRequest) -> Iterator[tuple[Transport, Transport]]:
    """Two programs that can reach one another."""
    made = pair(request.param)
    yield made
    for each in made:
        each.close()


def test_a_message_arrives_as_it_was_sent(both: tuple[Transport, Transport]) -> None:
    sender, receiver = both
    got: list[tuple[bytes, int]] = []
    receiver.subscribe(JOINTS, lambda message, at: got.append((message, at)))
    state = messages.joint_state(sender.clock(), ["a", "b"], np.array([0.5, -1.0]))
    sender.publish(JOINTS, state)
    until(lambda: len(got) > 0 or sender.publish(JOINTS, state) is not None)
    message, arrived = got[0]
    assert message[: len(state)] == state
    assert abs(arrived - receiver.clock()) < 5e9
    assert list(hashes.read(JOINTS.kind, message).position) == [0.5, -1.0]


def test_a_large_picture_costs_a_copy(both: tuple[Transport, Transport]) -> None:
    sender, receiver = both
    got: list[bytes] = []
    receiver.subscribe(PICTURES, lambda message, at: got.append(message))
    picture = messages.compressed_image(1, "camera", "raw", os.urandom(640 * 480 * 3))
    began = time.process_time()
    until(lambda: sender.publish(PICTURES, picture) is not None or len(got) > 0)
    assert got[0][: len(picture)] == picture
    # Packed value by value it would take 100 ms; the threads of DDS count, too.
    assert time.process_time() - began < 1.0


def test_the_time_to_the_other_program_and_back_is_measured(both: tuple[Transport, Transport]) -> None:
    measured = both[1].round_trip_s()
    assert measured is not None
    assert 0.0 <= measured < 0.5


def test_a_machine_that_answers_on_no_port_has_no_known_delay(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    monkeypatch.setattr(delay, "answered_s", lambda address, port: asked.append(port))
    assert delay.round_trip_s("127.0.0.1") is None
    assert asked == list(delay.PORTS)
    answers = iter([0.4, 0.03, 0.02, None, 0.01, 0.02])
    monkeypatch.setattr(delay, "answered_s", lambda address, port: next(answers))
    assert delay.round_trip_s("127.0.0.1") == 0.02


@pytest.mark.slow
@pytest.mark.parametrize("lifespan_s", [None, 0.05])
def test_a_command_without_a_stamp_is_not_sent_again_after_its_time(lifespan_s: float | None) -> None:
    pytest.importorskip("cyclonedds", reason="needs cyclonedds (extra `ros`)")
    from dextera_build.deploying.dds import Dds

    words = (sys.executable, "-m", "tests.deploying.frozen_reader", str(DOMAIN + 100), "8")
    reader = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    assert reader.stdout is not None
    assert reader.stdout.readline() == "ready\n"
    sender = Dds(domain=DOMAIN + 100)
    topic = Topic("/numbers", "std_msgs/Float64MultiArray", Quality(lifespan_s=lifespan_s))
    sender.offer(topic)
    until(lambda: any(each.topic == topic.name for each in sender.others()))
    time.sleep(0.5)
    for number in range(20):
        if number == 10:
            reader.send_signal(signal.SIGSTOP)
        sender.publish(topic, messages.numbers("a" * 150, np.full(150, float(number))))
        time.sleep(0.05)
    time.sleep(1.0)
    again = time.time_ns()
    reader.send_signal(signal.SIGCONT)
    got = [each.split(":") for each in reader.communicate(timeout=30)[0].split()]
    sender.close()
    late = [number for at, number in got if int(at) > again]
    assert len(got) - len(late) >= 3  # the small buffer loses some
    if lifespan_s is None:
        assert len(late) >= 6
    else:
        assert len(late) <= 3  # what had arrived in the buffer


def test_others_are_discovered_with_type_hash_and_quality(both: tuple[Transport, Transport]) -> None:
    one, other = both
    one.publish(JOINTS, messages.joint_state(1, ["a"], np.zeros(1)))
    one.subscribe(PICTURES, lambda message, at: None)
    wanted = {
        Endpoint(JOINTS.name, JOINTS.kind, True, Quality(), hashes.type_hash(JOINTS.kind)),
        Endpoint(PICTURES.name, PICTURES.kind, False, Quality(reliable=False), hashes.type_hash(PICTURES.kind)),
    }

    def found() -> set[Endpoint]:
        return {Endpoint(e.topic, e.kind, e.writes, Quality(e.quality.reliable), e.type_hash) for e in other.others()}

    until(lambda: found() == wanted)


@pytest.mark.parametrize("kind", ["loopback", "dds", "zenoh"])
def test_a_reader_that_asks_for_more_gets_nothing_but_by_zenoh(kind: str) -> None:
    sender, receiver = pair(kind)
    lossy = Topic("/lossy", JOINTS.kind, Quality(reliable=False))
    got: list[str] = []
    receiver.subscribe(Topic(lossy.name, lossy.kind, Quality()), lambda message, at: got.append("reliable"))
    until(lambda: bool(sender.others()))
    for _ in range(20):
        sender.publish(lossy, messages.joint_state(1, ["a"], np.zeros(1)))
        time.sleep(0.01)
    fits = receiver.fits(lossy.quality, Quality())
    assert fits == (kind == "zenoh")
    assert bool(got) == fits
    sender.close()
    receiver.close()


def test_a_late_reader_gets_the_last_message_of_a_topic_that_keeps_it(both: tuple[Transport, Transport]) -> None:
    sender, receiver = both
    kept = Topic("/kept", "std_msgs/String", Quality(keeps=True, depth=1))
    sender.publish(kept, messages.text("first"))
    sender.publish(kept, messages.text("last"))
    got: list[str] = []
    receiver.subscribe(kept, lambda message, at: got.append(hashes.read(kept.kind, message).data))
    until(lambda: got == ["last"])


def test_nothing_arrives_after_the_end(both: tuple[Transport, Transport]) -> None:
    sender, receiver = both
    got = threading.Event()
    receiver.subscribe(JOINTS, lambda message, at: got.set())
    receiver.close()
    sender.publish(JOINTS, messages.joint_state(1, ["a"], np.zeros(1)))
    assert not got.wait(0.2)


def test_the_end_does_not_fail_if_nobody_acknowledges(monkeypatch: pytest.MonkeyPatch) -> None:
    sender, receiver = pair("dds")
    receiver.close()
    sender.publish(JOINTS, messages.joint_state(1, ["a"], np.zeros(1)))
    from cyclonedds.core import DDSException
    from cyclonedds.pub import DataWriter

    late = DDSException.DDS_RETCODE_TIMEOUT
    monkeypatch.setattr(DataWriter, "_wait_for_acks", lambda *_: late)
    sender.close()


@pytest.mark.parametrize("kind", types.DEFINITIONS)
def test_hashes_are_those_of_ros(kind: str) -> None:
    rosbags = pytest.importorskip("rosbags.typesys", reason="needs rosbags (extra `ros`)")
    theirs = rosbags.get_typestore(rosbags.Stores.ROS2_KILTED)
    if types.full_name(kind) in theirs.fielddefs:
        assert hashes.type_hash(kind) == theirs.hash_rihs01(types.full_name(kind))


def test_bytes_of_another_message_are_refused() -> None:
    pytest.importorskip("rosbags", reason="needs rosbags (extra `ros`)")
    with pytest.raises(ValueError, match="7 bytes are no sensor_msgs/JointState"):
        hashes.read("sensor_msgs/JointState", b"\0\1\0\0abc")


@pytest.mark.slow
def test_a_node_of_ros_2_is_heard_and_hears(tmp_path: Path) -> None:
    pytest.importorskip("cyclonedds", reason="needs cyclonedds (extra `ros`)")
    from dextera_build.deploying.dds import Dds
    from tests.deploying import peers

    commands = Topic("/joint_trajectory", "trajectory_msgs/JointTrajectory")
    numbers, status = Topic("/numbers", "std_msgs/Float64MultiArray"), STATUS
    states: list[bytes] = []
    pictures: list[bytes] = []
    with peers.robot(DOMAIN, 12.0, tmp_path / "got.json", dict.fromkeys("abc", 0.1)) as node:
        transport = Dds(domain=DOMAIN)
        transport.subscribe(JOINTS, lambda message, at: states.append(message))
        transport.subscribe(PICTURES, lambda message, at: pictures.append(message))
        until(lambda: len(states) > 50 and len(pictures) > 5)
        for _ in range(10):
            transport.publish(commands, messages.joint_trajectory(0, "abc", np.array([0.2, 0.3, 0.4]), 50_000_000))
            transport.publish(numbers, messages.numbers("abc", np.array([1.0, 2.0, 3.0])))
            time.sleep(0.1)
        last = hashes.read(JOINTS.kind, states[-1])
        transport.publish(status, messages.text("stopped: over"))
        theirs = {each.topic: each for each in transport.others() if each.writes}
        got = node.ended()
        transport.close()
    assert dict(zip(last.name, last.position, strict=True)) == pytest.approx({"a": 0.2, "b": 0.3, "c": 0.4})
    assert len(hashes.read(PICTURES.kind, pictures[-1]).data) == 256 * 160
    assert theirs[JOINTS.name].type_hash == hashes.type_hash(JOINTS.kind)
    assert not theirs[PICTURES.name].quality.reliable
    assert [list("abc"), [0.2, 0.3, 0.4], 50_000_000] in got["trajectories"]
    assert [1.0, 2.0, 3.0] in got["numbers"]
    assert got["late"] == 0


@pytest.mark.slow
def test_a_node_by_zenoh_is_heard_and_hears() -> None:
    """ROBOTIS' zenoh-ros2-sdk has the names and hashes of rmw_zenoh from its own code."""
    pytest.importorskip("zenoh", reason="needs eclipse-zenoh (extra `zenoh`)")
    from dextera_build.deploying.zenoh_wire import Zenoh

    home = ENVIRONMENTS / "zenoh"
    if not (home / ".installed").exists():
        pytest.skip("needs .venv/readers/zenoh; `make readers` makes it")
    numbers, kept = Topic("/numbers", "std_msgs/Float64MultiArray"), Topic("/kept", STATUS.kind, STATUS.quality)
    port, states = free_port(), list[bytes]()
    router = Zenoh(f"127.0.0.1:{port}", DOMAIN, routes=True)
    transport = Zenoh(f"127.0.0.1:{port}", DOMAIN)
    transport.publish(kept, messages.text("before it came"))
    transport.subscribe(JOINTS, lambda message, at: states.append(message))
    script = Path(__file__).with_name("zenoh_node.py")
    command = [str(home / "bin" / "python"), str(script), str(port), str(DOMAIN), "4"]
    node = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    until(lambda: len(states) > 50, 30)
    transport.publish(numbers, messages.numbers("abc", np.array([1.0, 2.0, 3.0])))
    theirs = {each.topic: each for each in transport.others()}
    out, _ = node.communicate(timeout=30)
    transport.close()
    router.close()
    got = json.loads(out.splitlines()[-1])
    last = hashes.read(JOINTS.kind, states[-1])
    assert dict(zip(last.name, last.position, strict=True)) == {"a": 0.5, "b": -1.0}
    assert (got["numbers"], got["kept"]) == ([[1.0, 2.0, 3.0]], ["before it came"])
    assert got["hashes"] == [hashes.type_hash(each.kind) for each in (JOINTS, numbers, kept)]
    assert (theirs["/joint_states"].writes, theirs["/numbers"].writes) == (True, False)
    assert theirs["/kept"].quality == STATUS.quality


def test_an_absent_router_is_named() -> None:
    pytest.importorskip("zenoh", reason="needs eclipse-zenoh (extra `zenoh`)")
    from dextera_build.deploying.zenoh_wire import Zenoh

    with pytest.raises(MachineError, match="no Zenoh router answers") as absent:
        Zenoh("127.0.0.1:1")
    assert "`tcp/127.0.0.1:1`" in str(absent.value)
    assert "rmw_zenohd" in str(absent.value.hint)
    address = f"127.0.0.1:{free_port()}"
    router = Zenoh(address, routes=True)
    with pytest.raises(MachineError, match="no Zenoh router can listen"):
        Zenoh(address, routes=True)
    router.close()


@pytest.mark.parametrize(
    "token",
    [
        "@ros2_lv/0/zid/0/0/NN/%/%/dxb",
        "@ros2_lv/0/zid/0/4/SS/%/%/n/%add/example_interfaces::srv::dds_::AddTwoInts_/RIHS01_0/::,10:,:,:,,",
        "@ros2_lv/0/zid/0/4/MP/%/%/n/%a/std_msgs::msg::dds_::String_/RIHS01_0/::",
    ],
)
def test_tokens_of_nodes_services_and_other_forms_are_no_endpoints(token: str) -> None:
    from dextera_build.deploying.zenoh_wire import endpoint

    assert endpoint(token) is None


def test_the_end_of_python_does_not_wait_for_cyclone_dds() -> None:
    """Its domain is never deleted: deletion waits for threads of Cyclone DDS, now and then for ever."""
    pytest.importorskip("cyclonedds", reason="needs cyclonedds (extra `ros`)")
    text = """
import os
from cyclonedds import core
from dextera_build.deploying import dds
core.Entity.__del__ = lambda self, write=os.write: write(1, type(self).__name__.encode() + b" ")
dds.Dds(domain=77).close()
dds._DOMAINS.clear()  # as Python clears modules at its end
"""
    ended = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, timeout=60, check=True)
    assert "DomainParticipant" in ended.stdout
    assert "Domain" not in ended.stdout.split()


@pytest.mark.parametrize("kind", ["dds", "zenoh"])
def test_an_error_of_who_receives_ends_no_transport(kind: str) -> None:
    one, other = pair(kind)
    heard: list[bytes] = []

    def receive(message: bytes, arrived: int) -> None:
        heard.append(message)
        if len(heard) == 2:
            raise RuntimeError("it changed")

    other.subscribe(STATUS, receive)

    def published() -> bool:
        one.publish(STATUS, messages.text("running"))
        time.sleep(0.02)
        return len(heard) > 4

    until(published)
    assert one.fault == ""
    assert other.fault == "a message could not be taken: RuntimeError: it changed"
    one.close()
    other.close()
