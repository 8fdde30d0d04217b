"""Streams: what is recorded is read back by topic and time, and only what is asked for is read."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.base import File
from dextera_build.artifacts.robots.stream import Stream
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.errors import ArtifactError
from dextera_build.formats import mcap
from dextera_build.formats.ros import chunks, images, messages, reading
from dextera_build.formats.ros.recording import Recording
from tests.formats.test_trajectory import turning

RANDOM = np.random.default_rng(0)
NAMES = ("shoulder", "elbow")
STAMPS = 10 + 0.1 * np.arange(21)
JOINTS = Joints(
    names=NAMES, stamps=STAMPS, positions=RANDOM.normal(size=(21, 2)), velocities=RANDOM.normal(size=(21, 2))
)
PIXELS = RANDOM.integers(0, 256, (30, 24, 32, 3), np.uint8)


def pictures() -> mcap.Pictures:
    return mcap.Pictures(((10 + number / 15, each) for number, each in enumerate(PIXELS)), "camera")


@pytest.fixture
def stream(tmp_path: Path) -> Stream:
    path = turning()
    return mcap.record(
        tmp_path / "a.mcap",
        joints={"/joint_states": JOINTS},
        poses={"/hand": path},
        pictures={"/camera/compressed": pictures()},
    )


def test_the_index_tells_what_was_recorded(stream: Stream) -> None:
    found = {each.topic: (each.kind, each.count) for each in stream.channels}
    assert found == {
        "/camera/compressed": ("sensor_msgs/msg/CompressedImage", 30),
        "/hand": ("geometry_msgs/msg/PoseStamped", 3),
        "/joint_states": ("sensor_msgs/msg/JointState", 21),
    }
    assert list(stream.facts())[:2] == ["2.00 s", "54 messages"]
    assert stream.picture().startswith(b"\x89PNG")


def test_everything_comes_back(stream: Stream) -> None:
    joints = mcap.joints(stream, "/joint_states")
    assert joints.names == NAMES
    assert np.allclose(joints.stamps, STAMPS, rtol=0, atol=1e-9)
    assert (joints.positions == JOINTS.positions).all()
    assert (joints.velocities == JOINTS.velocities).all()
    assert joints.efforts is None
    path = mcap.poses(stream, "/hand", "camera")
    assert (path.parent, path.child) == ("world", "camera")
    assert (path.stamps == turning().stamps).all()
    assert (path.poses == turning().poses).all()
    found = list(mcap.pictures(stream, "/camera/compressed"))
    assert np.allclose([time for time, _ in found], 10 + np.arange(30) / 15)
    assert all((one == other).all() for (_, one), other in zip(found, PIXELS, strict=True))


def test_a_range_begins_with_its_start_and_ends_before_its_end(stream: Stream) -> None:
    some = mcap.joints(stream, "/joint_states", start=10.5, end=10.8)
    assert np.allclose(some.stamps, [10.5, 10.6, 10.7])
    assert len(mcap.joints(stream, "/joint_states", start=99.0).stamps) == 0
    assert len(list(mcap.pictures(stream, "/camera/compressed", end=10.3))) == 5


def test_joints_are_interpolated_to_the_pictures(stream: Stream) -> None:
    joints = mcap.joints(stream, "/joint_states")
    times = np.array([time for time, _ in mcap.pictures(stream, "/camera/compressed")])
    found = joints.at(times)
    wanted = [np.interp(times, STAMPS, JOINTS.positions[:, joint]) for joint in range(2)]
    assert np.allclose(found, np.stack(wanted, axis=1))
    with pytest.raises(ArtifactError, match="not recorded at all of these times") as caught:
        joints.at(np.array([11.0, 12.5]))
    assert caught.value.code == "DXB-A518"


class Counting(io.BufferedReader):
    """A file that counts the bytes that are read from it."""

    total = 0

    def read(self, size: int | None = -1) -> bytes:
        data = super().read(size)
        Counting.total += len(data)
        return data


@pytest.mark.medium
def test_only_the_asked_time_is_read(tmp_path: Path) -> None:
    """Noise does not compress, so the file is as large as the pictures."""
    frames = ((float(number), RANDOM.integers(0, 256, (480, 640, 3), np.uint8)) for number in range(40))
    path = tmp_path / "long.mcap"
    stream = mcap.record(path, pictures={"/camera": mcap.Pictures(frames, "camera")})
    assert path.stat().st_size > 35e6
    Counting.total = 0
    with Counting(io.FileIO(path)) as opened:
        reading.index(opened, "long.mcap")
    assert Counting.total < 50_000
    Counting.total = 0
    with Counting(io.FileIO(path)) as opened:
        limits = 20 * reading.SECOND, 22 * reading.SECOND
        assert len(list(reading.messages(opened, "long.mcap", ["/camera"], *limits))) == 2
    assert Counting.total < 4e6
    assert len(list(mcap.pictures(stream, "/camera", 20, 22))) == 2


@pytest.mark.parametrize(("data", "why"), [(b"", "MCAP"), (b"no recording" * 9, "invalid magic")])
def test_another_file_is_refused(tmp_path: Path, data: bytes, why: str) -> None:
    (tmp_path / "a.mcap").write_bytes(data)
    with pytest.raises(ArtifactError, match=r"`a.mcap` cannot be read as MCAP") as caught:
        mcap.load(tmp_path / "a.mcap")
    assert why.lower() in caught.value.facts["why"].lower() or not data


def test_a_recording_without_an_index_is_refused(stream: Stream, tmp_path: Path) -> None:
    whole = (tmp_path / "a.mcap").read_bytes()
    for size in range(len(whole) // 2, len(whole), len(whole) // 17):
        (tmp_path / "cut.mcap").write_bytes(whole[:size])
        with pytest.raises(ArtifactError) as caught:
            mcap.load(tmp_path / "cut.mcap")
        assert caught.value.code in {"DXB-A402", "DXB-A516"}
    buffer = io.BytesIO()
    from mcap.writer import Writer

    writer = Writer(buffer, use_statistics=False)
    writer.start()
    writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(ArtifactError, match="has no index") as caught:
        mcap.of(File(data=buffer.getvalue()))
    assert caught.value.code == "DXB-A516"


def packed(path: Path, count: int, times: int, chunk: int = 1 << 20, **more: Any) -> Path:
    """A recording of `count` messages of a megabyte of zeros, each of them at one of `times` times."""
    from mcap.writer import CompressionType, Writer

    writer = Writer(str(path), chunk_size=chunk, compression=CompressionType.ZSTD, **more)
    writer.start()
    channel = writer.register_channel("/a", "json", writer.register_schema("A", "jsonschema", b"{}"))
    for number in range(count):
        writer.add_message(channel, number % times, bytes(1 << 20), 0)
    writer.finish()  # type: ignore[no-untyped-call]
    return path


@pytest.mark.parametrize(("times", "chunk"), [(1, 1 << 20), (6, 1 << 30)], ids=["chunks at once", "one chunk"])
def test_a_small_recording_that_would_fill_the_memory_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, times: int, chunk: int
) -> None:
    monkeypatch.setattr(chunks, "MOST_BYTES", 5 << 20)
    assert mcap.load(packed(tmp_path / "long.mcap", 6, 6)).channels[0].count == 6
    with pytest.raises(ArtifactError, match=r"`a\.mcap` holds too many bytes at the same time") as caught:
        mcap.load(packed(tmp_path / "a.mcap", 6, times, chunk))
    assert (caught.value.code, caught.value.facts["most"]) == ("DXB-A407", "5,242,880")


def test_chunks_that_are_larger_than_the_index_says_are_refused(tmp_path: Path) -> None:
    path = packed(tmp_path / "a.mcap", 6, 6, 1 << 30)
    data = path.read_bytes()
    size, small = data[data.index(b"zstd") - 16 :][:8], (1000).to_bytes(8, "little")
    assert data.count(size) == 2
    first, last = data.index(size), data.rindex(size)
    for places in ((last,), (first, last)):  # in the index, and in the chunk, too
        changed = bytearray(data)
        for place in places:
            changed[place : place + 8] = small
        path.write_bytes(changed)
        with pytest.raises(ArtifactError) as caught:
            mcap.load(path)
        assert "a chunk is larger than its size in the index" in caught.value.facts["why"]


def test_chunks_without_an_index_are_refused(tmp_path: Path) -> None:
    from mcap.writer import IndexType

    with pytest.raises(ArtifactError) as caught:
        mcap.load(packed(tmp_path / "a.mcap", 6, 6, index_types=IndexType.NONE))
    assert "it has no index of its chunks" in caught.value.facts["why"]


def test_a_damaged_chunk_is_reported(stream: Stream, tmp_path: Path) -> None:
    data = bytearray((tmp_path / "a.mcap").read_bytes())
    data[len(data) // 3 : len(data) // 3 + 400] = bytes(400)
    (tmp_path / "bad.mcap").write_bytes(data)
    with pytest.raises(ArtifactError, match="cannot be read as") as caught:
        list(mcap.pictures(mcap.load(tmp_path / "bad.mcap"), "/camera/compressed"))
    assert caught.value.code == "DXB-A402"


def test_an_unknown_topic_names_the_known_ones(stream: Stream) -> None:
    for wrong in ("/joints", "/hand"):
        with pytest.raises(ArtifactError, match=f"there is no topic `{wrong}` of sensor_msgs/msg/JointState") as caught:
            mcap.joints(stream, wrong)
        assert caught.value.code == "DXB-A520"
        assert "/joint_states (sensor_msgs/msg/JointState)" in caught.value.facts["topics"]


def test_joints_that_change_are_refused(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as out, Recording(out) as recording:
        for time, names in enumerate((("a", "b"), ("a", "c"))):
            recording.send("/joints", "sensor_msgs/JointState", time, messages.joint_state(time, names, np.zeros(2)))
    with pytest.raises(ArtifactError, match="change during the recording") as caught:
        mcap.joints(mcap.load(tmp_path / "a.mcap"), "/joints")
    assert caught.value.code == "DXB-A519"
    with pytest.raises(ArtifactError, match="1 different names for 2 columns") as caught:
        Joints(names=("a", "a"), stamps=np.zeros(1), positions=np.zeros((1, 2)))
    assert caught.value.code == "DXB-A517"


class Raw:
    """A `sensor_msgs/Image`."""

    def __init__(self, encoding: str, data: bytes, step: int) -> None:
        self.encoding, self.data, self.step, self.width, self.height = encoding, data, step, 2, 1


@pytest.mark.parametrize(
    ("encoding", "data", "wanted"),
    [
        ("rgb8", bytes([1, 2, 3, 4, 5, 6, 99, 99]), [[1, 2, 3], [4, 5, 6]]),  # rows may be padded
        ("bgr8", bytes([1, 2, 3, 4, 5, 6]), [[3, 2, 1], [6, 5, 4]]),
        ("bgra8", bytes([1, 2, 3, 0, 4, 5, 6, 0]), [[3, 2, 1], [6, 5, 4]]),
        ("mono8", bytes([7, 8]), [[7, 7, 7], [8, 8, 8]]),
    ],
)
def test_raw_pictures_are_red_green_blue(encoding: str, data: bytes, wanted: list[list[int]]) -> None:
    assert images.pixels(Raw(encoding, data, len(data)), "/camera").tolist() == [wanted]


@pytest.mark.parametrize(
    ("raw", "why"), [(Raw("16UC1", bytes(4), 4), "`16UC1` is not"), (Raw("rgb8", bytes(5), 6), "5 bytes")]
)
def test_other_pictures_are_refused(raw: Raw, why: str) -> None:
    with pytest.raises(ArtifactError, match="cannot be read as a picture") as caught:
        images.pixels(raw, "/camera")
    assert why in caught.value.facts["why"]


def test_it_is_stored_without_being_read(stream: Stream, tmp_path: Path) -> None:
    """`save` gives the same bytes."""
    stream.save(tmp_path / "b.mcap")
    assert (tmp_path / "b.mcap").read_bytes() == (tmp_path / "a.mcap").read_bytes()
