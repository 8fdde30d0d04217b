"""Topics by rosbridge: with a server that others wrote, in front of a node of ROS 2, and messages as plain data."""

from __future__ import annotations

import itertools
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs rosbags (extra `ros`)")
pytest.importorskip("websockets", reason="needs websockets (extra `serve`)")

from dextera_build.deploying.rosbridge import Rosbridge, url
from dextera_build.deploying.topics import STATUS
from dextera_build.deploying.transport import SENSOR, Topic
from dextera_build.errors import MachineError
from dextera_build.formats.ros import hashes, messages, plain
from dextera_build.geometry import poses
from tests import factories
from tests.deploying import bridges, peers
from tests.deploying.test_transport import DOMAIN, JOINTS, PICTURES, until

SAMPLES = {
    "sensor_msgs/JointState": messages.joint_state(1_500_000_002, ["a", "b"], np.array([0.5, -1.0])),
    "trajectory_msgs/JointTrajectory": messages.joint_trajectory(7, ["a"], np.array([0.25]), 50_000_000),
    "tf2_msgs/TFMessage": messages.transforms(9, [("base", "box", poses.from_matrix(factories.pose(0.1, yaw=0.3)))]),
    "std_msgs/Float64MultiArray": messages.numbers("ab", np.array([1.0, 2.0])),
    "std_msgs/String": messages.text("stopped: the operator stopped it"),
    "sensor_msgs/CompressedImage": messages.compressed_image(3, "eye", "jpeg", bytes(range(256))),
    "sensor_msgs/Image": messages.depth_image(4, "eye", np.arange(12, dtype=np.uint16).reshape(3, 4)),
    "sensor_msgs/CameraInfo": messages.camera_info(5, "eye", factories.camera(64, 48)),
}


@pytest.mark.parametrize("kind", SAMPLES)
def test_messages_become_plain_data_and_return(kind: str) -> None:
    fields = plain.plain(kind, SAMPLES[kind])
    back = plain.message(kind, fields)
    assert plain.plain(kind, back) == fields
    assert back[: len(SAMPLES[kind])] == SAMPLES[kind]


def test_plain_data_has_the_forms_of_rosbridge() -> None:
    state = plain.plain("sensor_msgs/JointState", SAMPLES["sensor_msgs/JointState"])
    assert state["header"] == {"stamp": {"sec": 1, "nanosec": 500_000_002}, "frame_id": ""}
    assert (state["name"], state["position"], state["velocity"]) == (["a", "b"], [0.5, -1.0], [])
    picture = plain.plain("sensor_msgs/CompressedImage", SAMPLES["sensor_msgs/CompressedImage"])
    assert picture["data"].startswith("AAECAwQF")
    # JSON has no other numbers than finite ones.
    nan = messages.joint_state(0, ["a", "b"], np.array([np.nan, 1.0]))
    assert plain.plain("sensor_msgs/JointState", nan)["position"] == [None, 1.0]
    read = hashes.read("sensor_msgs/JointState", plain.message("sensor_msgs/JointState", {"position": [None, 2]}))
    assert np.isnan(read.position[0])
    assert read.position[1] == 2.0
    bytes_as_numbers = plain.message("sensor_msgs/CompressedImage", {"data": [1, 2, 255]})
    assert bytes(hashes.read("sensor_msgs/CompressedImage", bytes_as_numbers).data) == b"\x01\x02\xff"


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ([], "is an object of fields"),
        ({"positions": [1.0]}, "has no field positions"),
        ({"position": "far"}, "this is no sensor_msgs/JointState"),
        ({"header": 3}, "is an object of fields"),
        ({"header": {"stamp": {"sec": 2**33}}}, "this is no sensor_msgs/JointState"),
    ],
)
def test_plain_data_of_another_message_is_refused(fields: object, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        plain.message("sensor_msgs/JointState", fields)


def test_addresses_of_servers() -> None:
    assert url("192.168.1.20") == "ws://192.168.1.20:9090"
    assert url("robot.local:9191") == "ws://robot.local:9191"
    assert url("wss://robot.local/bridge") == "wss://robot.local/bridge"


def test_an_absent_server_is_named() -> None:
    with pytest.raises(MachineError, match=r"no server of rosbridge answers at `ws://127.0.0.1:1`") as absent:
        Rosbridge("127.0.0.1:1")
    assert "rosbridge_websocket_launch.xml" in str(absent.value.hint)


@pytest.mark.slow
def test_a_node_of_ros_2_behind_a_server_is_heard_and_hears(tmp_path: Path) -> None:
    commands = Topic("/joint_trajectory", "trajectory_msgs/JointTrajectory")
    numbers = Topic("/numbers", "std_msgs/Float64MultiArray")
    states: list[bytes] = []
    pictures: list[bytes] = []
    with (
        bridges.server(DOMAIN, tmp_path) as port,
        peers.robot(DOMAIN, 30.0, tmp_path / "got.json", dict.fromkeys("abc", 0.1)) as node,
    ):
        transport = Rosbridge(f"127.0.0.1:{port}")
        with pytest.raises(MachineError, match="does not say which nodes there are"):
            transport.others()
        transport.subscribe(Topic(JOINTS.name, JOINTS.kind, SENSOR), lambda message, at: states.append(message))
        transport.subscribe(PICTURES, lambda message, at: pictures.append(message))
        until(lambda: len(states) > 50 and len(pictures) > 5, 20)
        until(lambda: _moved(transport, commands, numbers, states), 15)
        measured = transport.round_trip_s()
        assert measured is not None
        assert 0.0 < measured < 0.5
        transport.publish(STATUS, messages.text("stopped: over"))
        count = len(states)
        until(lambda: len(states) > count + 20)
        transport.close()
        heard = len(states)
        got = node.ended()
    assert len(states) == heard
    stamps = [hashes.read(JOINTS.kind, each).header.stamp for each in states]
    assert all((one.sec, one.nanosec) < (two.sec, two.nanosec) for one, two in itertools.pairwise(stamps))
    assert bytes(hashes.read(PICTURES.kind, pictures[-1]).data) == bytes(range(256)) * 160
    assert [list("abc"), [0.2, 0.3, 0.4], 50_000_000] in got["trajectories"]
    assert [1.0, 2.0, 3.0] in got["numbers"]
    assert got["status"] == ["stopped: over"]
    assert got["late"] == 0


def _moved(transport: Rosbridge, commands: Topic, numbers: Topic, states: list[bytes]) -> bool:
    """Command the robot once more; whether it is there."""
    transport.publish(commands, messages.joint_trajectory(0, "abc", np.array([0.2, 0.3, 0.4]), 50_000_000))
    transport.publish(numbers, messages.numbers("abc", np.array([1.0, 2.0, 3.0])))
    time.sleep(0.1)
    last = hashes.read(JOINTS.kind, states[-1])
    return dict(zip(last.name, last.position, strict=True)) == {"a": 0.2, "b": 0.3, "c": 0.4}
