"""Recordings of Foxglove's schemas, protobuf and JSON, written by the libraries themselves."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import png
from dextera_build.artifacts.robots.stream import Stream
from dextera_build.errors import ArtifactError
from dextera_build.formats import mcap

STAMPS_NS = [1_700_000_000_000_000_000 + 50_000_000 * number for number in range(6)]
POSITIONS = np.random.default_rng(3).normal(size=(6, 2))
PIXELS = np.random.default_rng(4).integers(0, 256, (6, 8, 10, 3), np.uint8)
COUNTS = np.arange(80, dtype=np.uint16).reshape(8, 10) * 10
K = [100.0, 0.0, 4.5, 0.0, 101.0, 3.5, 0.0, 0.0, 1.0]


def as_json(path: Path) -> Stream:
    """A recording as Foxglove's JSON schemas have it."""
    from mcap.writer import Writer

    with path.open("wb") as out:
        writer = Writer(out)
        writer.start(profile="", library="test")
        channels = {}
        kinds = {
            "/joints": "foxglove.JointStates",
            "/image": "foxglove.CompressedImage",
            "/depth": "foxglove.RawImage",
            "/camera": "foxglove.CameraCalibration",
            "/hand": "foxglove.PoseInFrame",
        }
        for topic, kind in kinds.items():
            schema = writer.register_schema(kind, "jsonschema", b'{"type": "object"}')
            channels[topic] = writer.register_channel(topic, "json", schema)
        for number, time in enumerate(STAMPS_NS):
            head = {"timestamp": {"sec": time // 10**9, "nsec": time % 10**9}, "frame_id": "camera"}
            rows = [{"name": name, "position": POSITIONS[number, j]} for j, name in enumerate(("a", "b"))]
            image = base64.b64encode(png(PIXELS[number])).decode()
            depth = base64.b64encode(COUNTS.tobytes()).decode()
            pose = {
                "position": {"x": 0.1 * number, "y": 0.2, "z": 0.3},
                "orientation": {"x": 0.0, "y": 0.0, "z": 0.6, "w": 0.8},
            }
            size = {"width": 10, "height": 8}
            messages: dict[str, Any] = {
                "/joints": {**head, "joints": rows},
                "/image": {**head, "data": image, "format": "png"},
                "/depth": {**head, **size, "encoding": "16UC1", "step": 20, "data": depth},
                "/camera": {**head, **size, "distortion_model": "plumb_bob", "D": [0.0] * 5, "K": K},
                "/hand": {**head, "pose": pose},
            }
            for topic, message in messages.items():
                writer.add_message(channels[topic], time, json.dumps(message).encode(), time)
        writer.finish()
    return mcap.load(path)


def as_protobuf(path: Path) -> Stream:
    """The same as protobuf."""
    from foxglove_schemas_protobuf import (
        CameraCalibration_pb2,
        CompressedImage_pb2,
        JointState_pb2,
        JointStates_pb2,
        Pose_pb2,
        PoseInFrame_pb2,
        Quaternion_pb2,
        RawImage_pb2,
        Vector3_pb2,
    )
    from google.protobuf.timestamp_pb2 import Timestamp
    from mcap_protobuf.writer import Writer

    with path.open("wb") as out, Writer(out) as writer:
        for number, time in enumerate(STAMPS_NS):
            stamp: Any = {"timestamp": Timestamp(seconds=time // 10**9, nanos=time % 10**9)}
            head = {**stamp, "frame_id": "camera"}
            rows = [
                JointState_pb2.JointState(name=name, position=POSITIONS[number, j]) for j, name in enumerate(("a", "b"))
            ]
            pose = Pose_pb2.Pose(
                position=Vector3_pb2.Vector3(x=0.1 * number, y=0.2, z=0.3),
                orientation=Quaternion_pb2.Quaternion(z=0.6, w=0.8),
            )
            size = {"width": 10, "height": 8}
            lens = CameraCalibration_pb2.CameraCalibration(
                **head, **size, distortion_model="plumb_bob", D=[0.0] * 5, K=K
            )
            depth = RawImage_pb2.RawImage(**head, **size, encoding="16UC1", step=20, data=COUNTS.tobytes())
            image = CompressedImage_pb2.CompressedImage(**head, data=png(PIXELS[number]), format="png")
            messages = {
                "/joints": JointStates_pb2.JointStates(**stamp, joints=rows),
                "/image": image,
                "/depth": depth,
                "/camera": lens,
                "/hand": PoseInFrame_pb2.PoseInFrame(**head, pose=pose),
            }
            for topic, message in messages.items():
                writer.write_message(topic, message, time, time)
    return mcap.load(path)


@pytest.fixture(params=[as_json, as_protobuf])
def stream(request: pytest.FixtureRequest, tmp_path: Path) -> Stream:
    if request.param is as_protobuf:
        for package in ("mcap_protobuf", "foxglove_schemas_protobuf"):
            pytest.importorskip(package, reason=f"needs {package}")
    return request.param(tmp_path / "a.mcap")  # type: ignore[no-any-return]


def test_everything_comes_back(stream: Stream) -> None:
    joints = mcap.joints(stream, "/joints")
    assert joints.names == ("a", "b")
    np.testing.assert_array_equal(joints.positions, POSITIONS)
    np.testing.assert_allclose(joints.stamps, np.array(STAMPS_NS) / 1e9, rtol=0, atol=1e-6)
    assert joints.velocities is None
    found = np.stack([pixels for _, pixels in mcap.pictures(stream, "/image")])
    np.testing.assert_array_equal(found, PIXELS)
    for _, depth in mcap.depths(stream, "/depth"):
        np.testing.assert_allclose(depth, COUNTS * 0.001, rtol=1e-6)
    assert mcap.lens(stream, "/camera") == Camera(width=10, height=8, fx=100.0, fy=101.0, cx=4.5, cy=3.5)
    hand = mcap.poses(stream, "/hand", "hand")
    np.testing.assert_allclose(hand.poses[2], [0.2, 0.2, 0.3, 0.8, 0.0, 0.0, 0.6])
    assert mcap.number(stream, "/image") is None


def test_a_topic_of_another_type_is_refused(stream: Stream) -> None:
    with pytest.raises(ArtifactError, match="no topic `/image`"):
        mcap.joints(stream, "/image")
