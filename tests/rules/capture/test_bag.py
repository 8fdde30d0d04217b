"""capture.bag: bags of ROS 1 and ROS 2 come out as the same recording."""

from __future__ import annotations

import resource
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import File, Folder
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.errors import RuleError
from dextera_build.formats import hand_stream, mcap
from dextera_build.testing import RuleRunner
from tests.hand_streams import with_buttons
from tests.rules.capture.bags import Bag, files

pytest.importorskip("rosbags", reason="needs rosbags (extra `recordings`)")

START = 1.7e9
STAMPS = START + 0.02 * np.arange(40)
JOINTS = Joints(names=("a", "b"), stamps=STAMPS, positions=np.random.default_rng(0).normal(size=(40, 2)))
FRAMES = {START + 0.1 * n: np.random.default_rng(n).integers(0, 256, (12, 16, 3), dtype=np.uint8) for n in range(5)}
COUNTS = {stamp: np.full((12, 16), 700 + n, np.uint16) for n, stamp in enumerate(FRAMES)}
CAMERA = Camera(width=16, height=12, fx=20.0, fy=20.0, cx=7.5, cy=5.5)
COLOUR = "/device_0/sensor_1/Color_0/image/data"
"""Topics as librealsense names them."""
DEPTH = "/device_0/sensor_0/Depth_0/image/data"


def bag(path: Path, sqlite: bool = False) -> Path:
    made = Bag(path, sqlite).joints("/joint_states", JOINTS).pictures(COLOUR, FRAMES)
    made.pictures(DEPTH, COUNTS, "mono16").lens("/device_0/sensor_1/Color_0/info/camera_info", CAMERA, START)
    made.number("/device_0/sensor_0/option/Depth_Units/value", 0.00025, START).text("/rosout", "hello", START)
    return made.write()


def given(form: str, place: Path) -> File | Folder:
    """A bag of a form as the rule gets it."""
    if form == "ros1":
        return File.of(bag(place / "a.bag"))
    folder = bag(place / "bag", sqlite="sqlite" in form)
    if form.startswith("file"):
        return File.of(next(path for path in folder.iterdir() if path.suffix in (".db3", ".mcap")))
    return Folder(files=dict(files(folder)))


@pytest.mark.medium
@pytest.mark.parametrize("form", ["ros1", "folder sqlite", "folder mcap", "file sqlite", "file mcap"])
def test_every_form_is_the_same_recording(form, tmp_path):
    found = RuleRunner(tmp_path / "run").run("capture.bag", file=given(form, tmp_path))
    joints = mcap.joints(found, "/joint_states")
    assert joints.names == ("a", "b")
    np.testing.assert_array_equal(joints.positions, JOINTS.positions)
    np.testing.assert_allclose(joints.stamps, STAMPS, rtol=0, atol=1e-6)
    seen = [pixels for _, pixels in mcap.pictures(found, COLOUR)]
    np.testing.assert_array_equal(seen, list(FRAMES.values()))
    scale = mcap.number(found, "/device_0/sensor_0/option/Depth_Units/value")
    assert scale == pytest.approx(0.00025)
    depths = [depth[3, 3] for _, depth in mcap.depths(found, DEPTH, scale_m=scale)]
    np.testing.assert_allclose(depths, 0.00025 * (700 + np.arange(5)), rtol=1e-6)
    assert mcap.lens(found, "/device_0/sensor_1/Color_0/info/camera_info") == CAMERA
    assert "/rosout" not in {each.topic for each in found.channels}


def test_the_same_bag_gives_the_same_bytes(tmp_path):
    file = given("ros1", tmp_path)
    one, other = (RuleRunner(tmp_path / name).run("capture.bag", file=file) for name in ("one", "other"))
    assert one.file.data == other.file.data


def refused(tmp_path: Path, file: File | Folder, **options: object) -> RuleError:
    with pytest.raises(RuleError) as caught:
        RuleRunner(tmp_path / "run").run("capture.bag", file=file, options=options)
    return caught.value


def test_topics_are_chosen_and_missing_ones_named(tmp_path):
    file = given("folder mcap", tmp_path)
    found = RuleRunner(tmp_path / "run").run("capture.bag", file=file, options={"topics": [COLOUR]})
    assert [each.topic for each in found.channels] == [COLOUR]
    error = refused(tmp_path, file, topics=["/joints"])
    assert "/joint_states (sensor_msgs/msg/JointState)" in error.facts["topics"]
    assert "`/joints`" in error.message


@pytest.mark.parametrize("form", ["ros1", "file sqlite", "file mcap"])
def test_a_bag_that_is_cut_short_is_refused(form, tmp_path):
    whole = given(form, tmp_path).data
    assert refused(tmp_path, File(data=whole[: len(whole) // 2])).message in (
        "the bag cannot be read",
        "the bag has no joint states, poses, hands or pictures",
    )


def test_a_small_bag_that_would_fill_the_memory_is_refused(tmp_path):
    from rosbags.rosbag1 import Writer

    large = Bag(tmp_path / "a.bag").pictures(COLOUR, {START: np.zeros((8_000, 8_000, 3), np.uint8)})
    large.packed = Writer.CompressionFormat.LZ4
    file = File(data=large.write().read_bytes())
    assert len(file.data) < 1_000_000
    before = resource.getrlimit(resource.RLIMIT_DATA)
    taken = 1024 * int(Path("/proc/self/status").read_text().partition("VmData:")[2].split()[0])
    resource.setrlimit(resource.RLIMIT_DATA, (taken + 128_000_000, before[1]))
    try:
        error = refused(tmp_path, file)
        assert resource.getrlimit(resource.RLIMIT_DATA)[0] == taken + 128_000_000
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)
    assert error.message == "the bag unpacks to more than fits in memory"
    assert error.facts["most"] == "4 GiB at once"


def test_metadata_without_an_end_is_refused(tmp_path):
    folder = dict(given("folder mcap", tmp_path).files)
    folder["metadata.yaml"] += b"a: &a {b: 1}\nc: {<<: [*a, *a]}\n"
    assert "merges mappings" in refused(tmp_path, Folder(files=folder)).message


def test_what_is_no_bag_is_refused(tmp_path):
    assert refused(tmp_path, File(data=b"version https://git-lfs")).message == "the file is not a bag"
    error = refused(tmp_path, Folder(files={"a.db3": b"x"}))
    assert "`metadata.yaml` is missing" in error.message
    only = Bag(tmp_path / "b.bag").text("/rosout", "hello", START).write()
    assert refused(tmp_path, File.of(only)).facts["topics"] == "/rosout (std_msgs/msg/String)"


def test_hands_in_a_bag_are_kept(tmp_path):
    made = with_buttons()
    given = File.of(made.save(tmp_path / "hands.mcap")[0])
    found = RuleRunner(tmp_path / "run").run("capture.bag", file=given)
    topics = ["/hands/about", "/hands/input", "/hands/left", "/hands/right", "/head"]
    assert [each.topic for each in found.channels] == topics
    read = hand_stream.of(found)
    for name in type(made).model_fields:
        np.testing.assert_array_equal(getattr(read, name), getattr(made, name))
