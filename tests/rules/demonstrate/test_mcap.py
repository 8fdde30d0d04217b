"""demonstrate.mcap: what ROS 2 readers get out is what was recorded."""

from __future__ import annotations

import importlib.util
import io
import json
import os
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from PIL import Image

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.errors import RuleError
from dextera_build.formats.ros import types as ros_types
from dextera_build.formats.ros.cdr import Cdr
from dextera_build.geometry import quaternions
from dextera_build.sim.model import skins
from dextera_build.sim.observe import shapes
from dextera_build.testing import RuleRunner
from tests import episodes, readers

STEPS = 7
BOXES = ("/scene/box/robot_description", "/scene/case/robot_description")
ONCE = ("/tf_static", "/robot_description", "/scene/objects", "/scene/static", *BOXES)
READER = Path(__file__).with_name("rosbags_reader.py")


def film(made: Episodes) -> Film:
    rng = np.random.default_rng(0)
    frames = {label: Film.packed(rng.integers(0, 256, (STEPS, 48, 64, 3), np.uint8)) for label in made.items}
    return Film(frames=frames, width=64, height=48)


@pytest.fixture(scope="module")
def made() -> Episodes:
    return episodes.small(2, STEPS)


@pytest.fixture(scope="module")
def folder(made: Episodes, tmp_path_factory: pytest.TempPathFactory) -> Folder:
    written: Folder = RuleRunner(tmp_path_factory.mktemp("mcap")).run(
        "demonstrate.mcap", bundle=episodes.bundle(), episodes=made, film=film(made), view=episodes.view()
    )
    return written


def read(data: bytes) -> dict[str, list[tuple[int, Any]]]:
    """Topic -> (log time [ns], decoded message) in order."""
    found = defaultdict(list)
    reader = make_reader(io.BytesIO(data), decoder_factories=[DecoderFactory()])
    for _, channel, message, decoded in reader.iter_decoded_messages():
        found[channel.topic].append((message.log_time, decoded))
    return dict(found)


@pytest.fixture(scope="module")
def topics(folder: Folder) -> dict[str, list[tuple[int, Any]]]:
    return read(folder.files["episode-000001.mcap"])


def stamp(message: Any) -> int:
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


def test_every_step_is_there_at_its_time(topics: dict[str, list[tuple[int, Any]]]) -> None:
    expected = [50_000_000 * step for step in range(STEPS)]
    for topic, messages in topics.items():
        assert [time for time, _ in messages] == ([0] if topic in ONCE else expected), topic
    assert [stamp(message) for _, message in topics["/joint_states"]] == expected


def test_joints_and_commands_have_names_and_values(topics: dict[str, list[tuple[int, Any]]], made: Episodes) -> None:
    episode = made.items["1"]
    for step, (_, message) in enumerate(topics["/joint_states"]):
        assert message.name == ["joint_1", "joint_2", "joint_3"]
        np.testing.assert_array_equal(message.position, episode.joints[step])
        assert message.velocity == message.effort == []
    for topic, rows in (("/joint_trajectory", episode.action), ("/executed/joint_trajectory", episode.executed)):
        for step, (_, message) in enumerate(topics[topic]):
            (point,) = message.points
            assert message.joint_names == ["joint_1", "joint_2", "joint_3"]
            np.testing.assert_array_equal(point.positions, rows[step])
            assert (point.time_from_start.sec, point.time_from_start.nanosec) == (0, 50_000_000)
    inner = [message.position[0] for _, message in topics["/objects/joint_states"]]
    np.testing.assert_array_equal(inner, episode.displacement[:, 0])


def test_frames_are_those_of_the_objects_base_and_camera(
    topics: dict[str, list[tuple[int, Any]]], made: Episodes
) -> None:
    episode = made.items["1"]
    for step, (_, message) in enumerate(topics["/tf"]):
        links = ["link_1", "link_2", "link_3", "case_lid"]
        assert [edge.child_frame_id for edge in message.transforms] == ["box", "case", *links]
        for edge, pose in zip(message.transforms, episode.objects[step], strict=False):
            assert edge.header.frame_id == "base"
            np.testing.assert_allclose(matrix(edge.transform), of_pose(pose), atol=1e-6)
    ((_, still),) = topics["/tf_static"]
    assert [(edge.header.frame_id, edge.child_frame_id) for edge in still.transforms] == [
        ("world", "base"),
        ("base", "workspace_color_optical_frame"),
    ]
    world_from_base, base_from_camera = (matrix(edge.transform) for edge in still.transforms)
    np.testing.assert_allclose(world_from_base, episodes.WORLD_FROM_BASE, atol=1e-12)
    np.testing.assert_allclose(world_from_base @ base_from_camera, episodes.view().camera_pose.matrix, atol=1e-12)


def test_viewers_find_the_robot_and_the_objects(
    folder: Folder, topics: dict[str, list[tuple[int, Any]]], made: Episodes
) -> None:
    ((_, description),) = topics["/robot_description"]
    reader = make_reader(io.BytesIO(folder.files["episode-000001.mcap"]))
    attached = {record.name: record.data for record in reader.iter_attachments()}
    assert attached["robot.urdf"].decode() == description.data
    robot = mujoco.MjModel.from_xml_string(description.data)
    data, episode = mujoco.MjData(robot), made.items["1"]
    for step in (0, STEPS - 1):
        frames = {"base": np.eye(4)}
        for edge in topics["/tf"][step][1].transforms:
            frames[edge.child_frame_id] = frames[edge.header.frame_id] @ matrix(edge.transform)
        for name, position in zip(made.joint_names, episode.joints[step], strict=True):
            data.joint(name).qpos[0] = position
        mujoco.mj_kinematics(robot, data)
        for link in ("link_1", "link_2", "link_3"):
            np.testing.assert_allclose(frames[link][:3, 3], data.body(link).xpos, atol=1e-6)
        lid = np.linalg.inv(frames["case"]) @ frames["case_lid"]
        angle = episode.displacement[step, 0]
        np.testing.assert_allclose(lid[:3, 3], [0, 0.05, 0.012], atol=1e-12)
        np.testing.assert_allclose(lid[1:3, 1], [np.cos(angle), -np.sin(angle)], atol=1e-6)
    ((_, objects),) = topics["/scene/objects"]
    box, _, lid = objects.markers
    assert [(each.header.frame_id, each.type, each.frame_locked) for each in objects.markers] == [
        (frame, 11, True) for frame in ("box", "case", "case_lid")
    ]
    corners = np.array([vector(point) for point in box.points])
    assert len(corners) % 3 == 0
    np.testing.assert_allclose(corners.max(axis=0), episodes.BOX_HALF_M, atol=1e-6)
    assert (round(box.color.r, 3), box.color.a, list(box.colors)) == (0.8, 1.0, [])
    np.testing.assert_allclose(np.array([vector(point) for point in lid.points])[:, 1].min(), -0.1, atol=1e-6)


def test_objects_are_boxes_for_viewers_without_markers(topics: dict[str, list[tuple[int, Any]]]) -> None:
    ((_, objects),) = topics["/scene/objects"]
    links = {}
    for topic in BOXES:
        ((_, message),) = topics[topic]
        links |= {link.get("name"): link for link in ElementTree.fromstring(message.data).iter("link")}
    for marker in objects.markers:
        corners = np.array([vector(point) for point in marker.points])
        box, origin = (links[marker.header.frame_id].find(f"visual/{each}") for each in ("geometry/box", "origin"))
        size, middle = (np.array(each.split(), float) for each in (box.get("size"), origin.get("xyz")))
        np.testing.assert_allclose(middle - size / 2, corners.min(axis=0), atol=1e-6)
        np.testing.assert_allclose(middle + size / 2, corners.max(axis=0), atol=1e-6)


def test_shapes_with_a_texture_are_cut_into_patches_of_one_colour() -> None:
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]], np.float32)
    faces, uv = np.array([[0, 1, 2], [0, 2, 3]]), corners[[0, 1, 2, 0, 2, 3], :2] / 0.1
    texture = np.zeros((2, 2, 3), np.uint8)
    texture[0, 0] = 255  # above x < 0.05, y > 0.05
    skin = skins.Skin(corners, faces, (1.0, 1.0, 1.0, 1.0), texture, uv)
    marker = shapes.triangles("box", "box/0", skin, np.array([0.0, 0.0, 0.02]), 2.0)
    cut = marker.points.reshape(-1, 3, 3)
    assert np.linalg.norm(np.cross(cut[:, 1] - cut[:, 0], cut[:, 2] - cut[:, 0]), axis=1).sum() / 2 == pytest.approx(
        0.04
    )
    np.testing.assert_allclose(marker.points[:, 2], -0.04)
    middle = cut.mean(axis=1)
    np.testing.assert_array_equal(marker.colours[::3, 0], (middle[:, 0] < 0.1) & (middle[:, 1] > 0.1))


def test_a_term_of_a_project_has_a_topic_that_names_its_numbers(made: Episodes, tmp_path: Path) -> None:
    values = np.arange(STEPS * 6, dtype=np.float32).reshape(STEPS, 2, 3)
    term = TermSpec(term="pull", about="a pull on each object", rows="objects", parts=("x", "y", "z"), unit="N")
    one = episodes.observed(made.items["0"], pull=values)
    shown = made.model_copy(update={"items": {"0": one}, "terms": {"pull": term}})
    written = RuleRunner(tmp_path).run("demonstrate.mcap", bundle=episodes.bundle(), episodes=shown)
    messages = [message for _, message in read(written.files["episode-000000.mcap"])["/pull"]]
    (dimension,) = messages[0].layout.dim
    assert (dimension.label, dimension.size) == ("box.x, box.y, box.z, case.x, case.y, case.z", 6)
    np.testing.assert_array_equal([message.data for message in messages], values.reshape(STEPS, 6))


def test_a_link_and_an_object_of_one_name_are_refused(made: Episodes, tmp_path: Path) -> None:
    bundle = episodes.bundle()
    scene = bundle.model.files["scene.xml"].replace(b'name="case_lid"', b'name="link_1"')
    clashing = bundle.model_copy(update={"model": Folder(files={"scene.xml": scene})})
    with pytest.raises(RuleError, match="name of a link of the robot"):
        RuleRunner(tmp_path).run("demonstrate.mcap", bundle=clashing, episodes=made)


def test_forces_targets_and_pictures_come_back(topics: dict[str, list[tuple[int, Any]]], made: Episodes) -> None:
    episode = made.items["1"]
    pixels = film(made).pixels("1")
    for step in range(STEPS):
        for number, tip in enumerate(made.tip_names):
            force = topics[f"/wrench/{tip}"][step][1]
            assert force.header.frame_id == "base"
            np.testing.assert_array_equal(vector(force.wrench.force), episode.contact[step, number])
        hand = topics["/target/hand"][step][1].pose
        np.testing.assert_array_equal(vector(hand.position), episode.hand[step, 0, :3])
        assert hand.orientation.w == episode.hand[step, 0, 3]
        image = topics["/workspace/color/image_raw/compressed"][step][1]
        assert (image.format, image.header.frame_id) == ("png", "workspace_color_optical_frame")
        np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(bytes(image.data)))), pixels[step])
        info = topics["/workspace/color/camera_info"][step][1]
        camera = episodes.view().camera
        assert (info.width, info.height, info.distortion_model) == (64, 48, "plumb_bob")
        np.testing.assert_array_equal(np.reshape(info.k, (3, 3)), camera.matrix())
        np.testing.assert_array_equal(np.reshape(info.p, (3, 4))[:, :3], camera.matrix())


def vector(message: Any) -> list[float]:
    return [message.x, message.y, message.z]


def matrix(transform: Any) -> np.ndarray:
    turn = transform.rotation
    return of_pose(np.array([*vector(transform.translation), turn.w, turn.x, turn.y, turn.z]))


def of_pose(pose: np.ndarray) -> np.ndarray:
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = quaternions.to_matrix(pose[3:]), pose[:3]
    return found


def test_the_file_says_what_it_is_and_how_to_begin_again(folder: Folder, made: Episodes) -> None:
    reader = make_reader(io.BytesIO(folder.files["episode-000000.mcap"]))
    assert reader.get_header().profile == "ros2"
    (facts,) = [record.metadata for record in reader.iter_metadata() if record.name == "episode"]
    assert facts["task"] == "LiftBox"
    assert facts["seed"] == str(made.items["0"].start.seed)
    assert (facts["outcome"], facts["reason"], facts["origin"]) == ("success", "", "operator")
    attached = {
        record.name: json.loads(record.data) for record in reader.iter_attachments() if record.name.endswith(".json")
    }
    assert attached["start.json"]["qpos"] == made.items["0"].start.qpos.tolist()
    assert attached["start.json"]["friction"] == {"box": 0.6, "case": 0.5}
    assert attached["task.json"]["goal"]["height_m"] == 0.1
    assert [segment["name"] for segment in attached["segments.json"]] == ["approach", "lift"]
    summary = reader.get_summary()
    assert summary is not None
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
    (still,) = [channel for channel in summary.channels.values() if channel.topic == "/tf_static"]
    assert "durability: 1" in still.metadata["offered_qos_profiles"]


def test_the_same_episodes_give_the_same_bytes(folder: Folder, made: Episodes, tmp_path: Path) -> None:
    again = RuleRunner(tmp_path).run(
        "demonstrate.mcap", bundle=episodes.bundle(), episodes=made, film=film(made), view=episodes.view()
    )
    assert again.files == folder.files


def test_without_pictures_there_is_no_camera(made: Episodes, tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path)
    plain = runner.run("demonstrate.mcap", bundle=episodes.bundle(), episodes=made, options={"compression": "none"})
    assert runner.outcome.line.startswith("2 recordings, without pictures")
    found = read(plain.files["episode-000000.mcap"])
    assert not any(topic.startswith("/workspace") for topic in found)
    assert len(found["/tf_static"][0][1].transforms) == 1


def test_pictures_can_be_jpeg(made: Episodes, tmp_path: Path) -> None:
    written = RuleRunner(tmp_path).run(
        "demonstrate.mcap",
        options={"picture": "jpeg"},
        bundle=episodes.bundle(),
        episodes=made,
        film=Film(
            frames={label: Film.packed(np.full((STEPS, 48, 64, 3), 90, np.uint8)) for label in made.items},
            width=64,
            height=48,
        ),
    )
    image = read(written.files["episode-000000.mcap"])["/workspace/color/image_raw/compressed"][0][1]
    assert image.format == "jpeg"
    np.testing.assert_allclose(np.asarray(Image.open(io.BytesIO(bytes(image.data)))), 90, atol=2)


def test_what_cannot_be_written_is_refused(made: Episodes, tmp_path: Path) -> None:
    runner, bundle = RuleRunner(tmp_path), episodes.bundle()
    with pytest.raises(RuleError, match="no episode counts"):
        runner.run("demonstrate.mcap", bundle=bundle, episodes=made.model_copy(update={"items": {}}))
    less = film(made).model_copy(update={"frames": {}})
    with pytest.raises(RuleError, match="the film does not show every episode"):
        runner.run("demonstrate.mcap", bundle=bundle, episodes=made, film=less)
    with pytest.raises(RuleError, match="not shot through this view") as refused:
        runner.run("demonstrate.mcap", bundle=bundle, episodes=made, film=film(made), view=episodes.view(32, 24))
    assert refused.value.facts == {"camera": "workspace", "film": "64 x 48 px", "view": "32 x 24 px"}


def test_the_stub_has_as_many_recordings(folder: Folder, made: Episodes, tmp_path: Path) -> None:
    stub = RuleRunner(tmp_path).run("demonstrate.mcap", profile="stub", bundle=episodes.bundle(), episodes=made)
    assert stub.files.keys() == folder.files.keys()


@given(st.lists(st.tuples(st.text(max_size=5), st.lists(st.floats(allow_nan=False), max_size=4)), max_size=5))
def test_values_are_aligned_as_the_reference_reader_expects(parts: list[tuple[str, list[float]]]) -> None:
    from mcap_ros2._dynamic import generate_dynamic

    parts = [(text.replace("\0", ""), numbers) for text, numbers in parts]
    fields = "\n".join(f"string s{n}\nfloat64[] d{n}\nbool b{n}\nint32 i{n}\nuint8[] u{n}" for n in range(len(parts)))
    written = Cdr()
    for number, (text, numbers) in enumerate(parts):
        written.string(text).f64s(numbers).boolean(number % 2 == 0).i32(-number).u8s(b"x" * number)
    decoded = generate_dynamic("test/Message", fields + "\nuint32 last")["test/Message"](written.u32(7).bytes())
    for number, (text, numbers) in enumerate(parts):
        assert getattr(decoded, f"s{number}") == text
        assert list(getattr(decoded, f"d{number}")) == numbers
        assert getattr(decoded, f"b{number}") is (number % 2 == 0)
        assert getattr(decoded, f"i{number}") == -number
        assert len(getattr(decoded, f"u{number}")) == number
    assert decoded.last == 7


def test_a_schema_holds_every_type_once() -> None:
    text = ros_types.schema("sensor_msgs/CameraInfo").decode()
    assert [line.removeprefix("MSG: ") for line in text.splitlines() if line.startswith("MSG: ")] == [
        "std_msgs/Header",
        "builtin_interfaces/Time",
        "sensor_msgs/RegionOfInterest",
    ]
    assert ros_types.full_name("sensor_msgs/CameraInfo") == "sensor_msgs/msg/CameraInfo"


@pytest.mark.slow
def test_rosbags_reads_it_too(folder: Folder, made: Episodes, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    target = Path(request.config.cache.mkdir("rosbags-0.11.9"))
    pins = ("rosbags==0.11.9", "apsw", "backports.zstd", "lz4", "ruamel.yaml", "typing_extensions")
    if importlib.util.find_spec("rosbags") is None and not (target / "rosbags").exists():
        pip = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", str(target), *pins]
        done = subprocess.run(pip, capture_output=True, text=True)
        if done.returncode:
            pytest.skip(f"rosbags 0.11.9 cannot be installed: {done.stderr.strip().splitlines()[-1]}")
    folder.export(tmp_path, "bag")
    out = tmp_path / "found.json"
    reader = [sys.executable, str(READER), str(tmp_path / "episode-000001.mcap"), str(out)]
    done = subprocess.run(reader, env=os.environ | {"PYTHONPATH": str(target)}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(out.read_text())
    episode = made.items["1"]
    np.testing.assert_array_equal(found["/joint_states"], episode.joints)
    np.testing.assert_array_equal(found["/joint_trajectory"], episode.action)
    np.testing.assert_array_equal(found["/wrench/tip_right"], episode.contact[:, 1])
    np.testing.assert_allclose(found["/tf"], np.roll(episode.objects[:, 0, 3:], -1, axis=1))
    assert found["qos"] == dict.fromkeys(ONCE, "TRANSIENT_LOCAL")


@pytest.mark.slow
def test_rerun_converts_robot_frames_joints_and_pictures(folder: Folder, made: Episodes, tmp_path: Path) -> None:
    (tmp_path / "episode.mcap").write_bytes(folder.files["episode-000001.mcap"])
    found = readers.read("rerun", "rerun_reader.py", tmp_path / "episode.mcap", tmp_path / "found.npz")
    episode = made.items["1"]
    np.testing.assert_array_equal(found["joints"], episode.joints)
    np.testing.assert_allclose(found["place"], episode.objects[:, 0, :3], atol=1e-6)
    assert len(found["images"]) == STEPS
    assert found["resolution"].tolist() == [64, 48]
    assert found["drawn"].tolist() == ["base", "box", "case", "case_lid", "link_1", "link_2", "link_3"]
