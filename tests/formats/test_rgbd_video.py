"""RGB-D video: its archive, what is refused, and units of depth."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import png
from dextera_build.artifacts.cameras.rgbd_video import RgbdFrame, RgbdVideo
from dextera_build.artifacts.robots.stream import Stream
from dextera_build.errors import ArtifactError
from dextera_build.formats import mcap
from dextera_build.formats.ros import messages
from dextera_build.formats.ros.cdr import Cdr
from dextera_build.formats.ros.recording import Recording
from tests.artifacts.generated import values
from tests.artifacts.test_base import Memory

CAMERA = Camera(width=40, height=30, fx=50.0, fy=51.0, cx=19.5, cy=14.5)


def frames(count: int = 3) -> list[RgbdFrame]:
    random = np.random.default_rng(0)
    pose = np.eye(4)
    pose[:3, 3] = 0.1, 0.2, 0.3
    return [
        RgbdFrame(
            number / 30,
            random.integers(0, 256, (30, 40, 3), dtype=np.uint8),
            random.uniform(0.3, 3.0, (30, 40)).astype(np.float32) * (random.random((30, 40)) > 0.1),
            pose,
        )
        for number in range(count)
    ]


@given(values(RgbdVideo))
@settings(deadline=None, max_examples=20)
def test_a_value_comes_back_from_a_store(made: RgbdVideo):
    memory = Memory()
    key = made.encode(memory.put)
    assert RgbdVideo.decode(key, memory.get).encode(memory.put) == key


def test_frames_come_back_one_by_one_and_by_number(tmp_path: Path):
    made = RgbdVideo.write(tmp_path / "a.zip", CAMERA, frames())
    (path,) = made.save(tmp_path / "b.zip")
    read = RgbdVideo.load(path)
    for before, after in zip(frames(), read.frames(), strict=True):
        assert np.array_equal(before.rgb, after.rgb)
        assert np.abs(before.depth - after.depth).max() <= 0.00011
        assert ((before.depth == 0) == (after.depth == 0)).all()
        assert np.array_equal(after.pose, before.pose)
    assert next(read.frames([2])).stamp == pytest.approx(2 / 30)
    assert read.picture()[:4] == b"\x89PNG"


def test_equal_frames_give_equal_bytes(tmp_path: Path):
    made = [RgbdVideo.write(tmp_path / name, CAMERA, frames()).encode(Memory().put) for name in ("a.zip", "b.zip")]
    assert made[0] == made[1]


def test_saturated_depth_is_not_measured(tmp_path: Path):
    """Trap 19: 0 and 65535 counts are invalid."""
    counts = np.full((30, 40), 1000, np.uint16)
    counts[0, 0], counts[0, 1] = 0, 65535
    colour = png(frames(1)[0].rgb)
    packed = RgbdVideo.pack(tmp_path / "a.zip", CAMERA, [(0.0, ".png", colour, png(counts), None)], depth_scale_m=0.001)
    depth = next(packed.frames()).depth
    assert depth[0, 0] == depth[0, 1] == 0
    assert depth[5, 5] == pytest.approx(1.0)


def test_a_frame_of_another_size_is_refused(tmp_path: Path):
    wrong = CAMERA.model_copy(update={"width": 20})
    with pytest.raises(ArtifactError, match="not have the size") as caught:
        RgbdVideo.write(tmp_path / "a.zip", wrong, frames())
    assert caught.value.code == "DXB-A547"


def test_times_that_do_not_increase_are_refused(tmp_path: Path):
    with pytest.raises(ArtifactError, match="do not increase"):
        RgbdVideo.write(tmp_path / "a.zip", CAMERA, frames()[::-1])


def test_an_archive_of_something_else_is_refused(tmp_path: Path):
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w") as archive:
        archive.writestr("a.txt", "b")
    (tmp_path / "a.zip").write_bytes(written.getvalue())
    with pytest.raises(ArtifactError, match="ZIP of an RGB-D video"):
        RgbdVideo.load(tmp_path / "a.zip")


def image(stamp: int, counts: np.ndarray) -> bytes:
    """`sensor_msgs/Image` of depth: uint16 [mm] as `16UC1`, float32 [m] as `32FC1`."""
    encoding = "16UC1" if counts.dtype == np.uint16 else "32FC1"
    seconds, nanoseconds = divmod(stamp, messages.SECOND)
    head = Cdr().i32(seconds).u32(nanoseconds).string("camera")
    head.u32(*counts.shape).string(encoding).boolean(False).u32(counts.strides[0])
    return head.u8s(counts.tobytes()).bytes()


def recording(path: Path, unit: str) -> Stream:
    """Three frames at 30 Hz, colour 4 ms after depth, with depth in millimetres or metres."""
    with path.open("wb") as out, Recording(out) as written:
        written.send("/info", "sensor_msgs/CameraInfo", 0, messages.camera_info(0, "camera", CAMERA))
        for frame in frames():
            time = round(frame.stamp * 1e9) + 1_000_000_000
            depth = np.round(frame.depth * 1000).astype(np.uint16) if unit == "mm" else frame.depth.copy()
            if unit == "m":
                depth[frame.depth == 0] = np.nan
            written.send("/depth", "sensor_msgs/Image", time, image(time, depth))
            later = time + 4_000_000
            picture = messages.compressed_image(later, "camera", "png", png(frame.rgb))
            written.send("/colour", "sensor_msgs/CompressedImage", later, picture)
    return mcap.load(path)


@pytest.mark.parametrize("unit", ["mm", "m"])
def test_depth_of_a_recording_is_in_metres(tmp_path: Path, unit: str):
    """Trap 19: millimetres or metres, NaN for what was not measured."""
    stream = recording(tmp_path / "a.mcap", unit)
    for (stamp, depth), frame in zip(mcap.depths(stream, "/depth"), frames(), strict=True):
        assert stamp == pytest.approx(frame.stamp + 1)
        assert np.abs(depth - frame.depth).max() <= 0.00051
    lens = mcap.lens(stream, "/info")
    assert isinstance(lens, Camera)
    assert (lens.width, lens.fx, lens.fy) == (40, 50.0, 51.0)


def test_colour_is_no_depth(tmp_path: Path):
    stream = recording(tmp_path / "a.mcap", "mm")
    with pytest.raises(ArtifactError, match="`colour` cannot be read as depth"):
        next(mcap.depths(stream, "/colour"))
