"""A transport by rclpy in a process of its own: messages both ways with a program of DDS, who else is there, faults."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="needs cyclonedds (extra `ros`)")

from dextera_build.deploying import rclpy_wire
from dextera_build.deploying.dds import Dds
from dextera_build.deploying.rclpy_wire import Rclpy
from dextera_build.deploying.topics import STATUS
from dextera_build.deploying.transport import SENSOR, Endpoint, Quality, Topic
from dextera_build.errors import MachineError
from dextera_build.formats.ros import hashes, messages
from tests.deploying import peers
from tests.deploying.test_transport import JOINTS, PICTURES, until

DOMAIN = 20 + (os.getpid() + 17) % 80


@pytest.fixture
def python(monkeypatch: pytest.MonkeyPatch) -> None:
    """A Python with rclpy is named."""
    monkeypatch.setenv(rclpy_wire.PYTHON, peers.python())


@pytest.fixture
def both(python: None) -> Iterator[tuple[Rclpy, Dds]]:
    """A node of rclpy and a program of DDS."""
    here, there = Rclpy(domain=DOMAIN), Dds(domain=DOMAIN)
    yield here, there
    here.close()
    there.close()


@pytest.mark.slow
def test_messages_pass_in_both_directions(both: tuple[Rclpy, Dds]) -> None:
    here, there = both
    state = messages.joint_state(here.clock(), ["a", "b"], np.array([0.5, -1.0]))
    got: list[bytes] = []
    heard: list[tuple[bytes, int]] = []
    there.subscribe(JOINTS, lambda message, _: got.append(message))
    here.subscribe(Topic("/back", JOINTS.kind, SENSOR), lambda message, at: heard.append((message, at)))
    until(lambda: len(got) > 0 or bool(here.publish(JOINTS, state)) or bool(time.sleep(0.1)))
    until(lambda: len(heard) > 0 or bool(there.publish(Topic("/back", JOINTS.kind), state)) or bool(time.sleep(0.1)))
    assert list(hashes.read(JOINTS.kind, got[0]).position) == [0.5, -1.0]
    assert heard[0][0][: len(state)] == state
    assert abs(heard[0][1] - here.clock()) < 5e9
    last: list[bytes] = []
    here.publish(STATUS, messages.text("running"))
    there.subscribe(STATUS, lambda message, _: last.append(message))
    until(lambda: len(last) > 0)  # who comes later gets the last one
    assert hashes.read(STATUS.kind, last[0]).data == "running"


@pytest.mark.slow
def test_it_knows_who_else_is_there(both: tuple[Rclpy, Dds]) -> None:
    here, there = both
    here.offer(STATUS)
    there.offer(PICTURES)
    there.subscribe(JOINTS, lambda *_: None)
    wanted = {
        Endpoint(PICTURES.name, PICTURES.kind, True, Quality(reliable=False), hashes.type_hash(PICTURES.kind)),
        Endpoint(JOINTS.name, JOINTS.kind, False, Quality(), hashes.type_hash(JOINTS.kind)),
    }
    until(lambda: wanted <= {*here.others()})
    assert STATUS.name not in {each.topic for each in here.others()}, "it is its own"
    assert here.fits(SENSOR, SENSOR)
    assert not here.fits(SENSOR, Quality())


@pytest.mark.slow
def test_a_node_that_ends_or_cannot_publish_is_one_clear_error(python: None) -> None:
    here = Rclpy(domain=DOMAIN)
    try:
        here.offer(Topic("/numbers", "no_such_package/Numbers"))
        until(lambda: raised(here, "no_such_package"))
    finally:
        here.close()
    here = Rclpy(domain=DOMAIN)
    os.kill(here.process_id, signal.SIGKILL)
    until(lambda: raised(here, "its process has ended"))
    here.close()


def raised(transport: Rclpy, why: str) -> bool:
    """Whether publishing raises the error."""
    try:
        transport.publish(STATUS, messages.text("running"))
    except MachineError as error:
        return why in error.message
    time.sleep(0.05)
    return False


def test_a_python_without_rclpy_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(rclpy_wire.PYTHON, "/bin/false")
    with pytest.raises(MachineError, match="cannot run a node of rclpy") as refused:
        Rclpy()
    assert rclpy_wire.PYTHON in str(refused.value.hint)
    monkeypatch.setenv(rclpy_wire.PYTHON, "/no/such/python")
    with pytest.raises(MachineError, match="cannot run a node of rclpy"):
        Rclpy()
