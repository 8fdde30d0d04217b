"""Views out of recordings: moments of rest, clocks, and joint states that are not those of the robot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.base import File
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.robots.stream import Stream
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.errors import RuleError
from dextera_build.formats import mcap
from dextera_build.testing import RuleRunner
from tests.rules.capture.bags import Bag
from tests.rules.capture.moving_robot import (
    CAMERA,
    LENGTH,
    NAMES,
    OFFSET,
    POSTURES,
    START,
    frames,
    recording,
    states,
    three_hinges,
)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return three_hinges(tmp_path_factory.mktemp("robot"))


@pytest.fixture(scope="module")
def stream(tmp_path_factory: pytest.TempPathFactory) -> Stream:
    return recording(tmp_path_factory.mktemp("recording") / "a.mcap", states())


@pytest.fixture(scope="module")
def camera_only(tmp_path_factory: pytest.TempPathFactory) -> Stream:
    return recording(tmp_path_factory.mktemp("recording") / "b.mcap", None)


def separate(path: Path, joints: Joints) -> Stream:
    return mcap.record(path / "states.mcap", joints={"/joint_states": joints})


@pytest.mark.medium
def test_each_rest_is_a_view_with_its_joints(stream, robot, tmp_path):
    runner = RuleRunner(tmp_path)
    found = runner.run("capture.recorded_views", stream=stream, robot=robot)
    assert len(found.captures) == len(POSTURES)
    np.testing.assert_allclose(found.joints.positions, POSTURES, atol=1e-3)
    assert found.joints.names == NAMES
    assert (found.skew_s < 0.006).all()
    offset, sigma = runner.outcome.metrics["clock_offset"][0], runner.outcome.metrics["clock_offset_sigma"][0]
    assert abs(offset - OFFSET) < max(0.012, 3 * sigma)
    assert sigma < 0.04
    assert any("ahead of the camera's" in each for each in runner.outcome.warnings)
    assert found.captures["view_01"].photograph.camera == CAMERA


def test_a_given_offset_is_used(stream, tmp_path):
    runner = RuleRunner(tmp_path)
    found = runner.run("capture.recorded_views", stream=stream, options={"clock_offset_s": OFFSET})
    np.testing.assert_allclose(found.joints.positions, POSTURES, atol=1e-3)
    assert not runner.outcome.warnings


def test_few_pictures_do_not_tell_the_offset(tmp_path):
    runner = RuleRunner(tmp_path)
    runner.run("capture.recorded_views", stream=recording(tmp_path / "few.mcap", states(), rate=1.7))
    assert "assuming synchronised clocks" in runner.outcome.warnings[0]


def test_columns_come_in_the_order_of_the_model(camera_only, robot, tmp_path):
    mixed = states(names=("c", "x", "a", "b"), positions=states().positions[:, [2, 0, 0, 1]])
    found = RuleRunner(tmp_path).run(
        "capture.recorded_views", stream=camera_only, states=separate(tmp_path, mixed), robot=robot
    )
    assert found.joints.names == NAMES
    np.testing.assert_allclose(found.joints.positions, POSTURES, atol=1e-3)


def refused(tmp_path: Path, camera_only: Stream, joints: Joints, **more: Any) -> RuleError:
    with pytest.raises(RuleError) as caught:
        RuleRunner(tmp_path).run(
            "capture.recorded_views", stream=camera_only, states=separate(tmp_path, joints), **more
        )
    return caught.value


def test_degrees_are_refused(camera_only, robot, tmp_path):
    error = refused(tmp_path, camera_only, states(positions=np.degrees(states().positions)), robot=robot)
    assert "not those of this robot: they fit as degrees" in error.message
    assert "limits -1.4 to 1.4" in error.facts["a"]


def test_small_degrees_are_refused_by_their_speed(camera_only, robot, tmp_path):
    """Degrees that are within the limits as radians, but change too fast."""
    small = POSTURES[0] + 0.02 * (states().positions - POSTURES[0])
    shifted = np.degrees(small) - np.degrees(small).mean(axis=0) + np.array([0.0, 1.2, 0.1])
    assert np.abs(shifted - [0, 1.2, 0.1]).max() < 1.7
    error = refused(tmp_path, camera_only, states(positions=40 * (shifted - shifted[0]) + POSTURES[0]), robot=robot)
    assert "not those of this robot" in error.message


def test_another_order_is_refused_with_what_would_fit(camera_only, robot, tmp_path):
    error = refused(tmp_path, camera_only, states(positions=states().positions[:, [1, 2, 0]]), robot=robot)
    assert "their columns fit in another order" in error.message
    assert "`a` holds b, `b` holds c, `c` holds a" in error.message
    assert {"a", "b", "c"} >= set(error.facts)


@pytest.mark.medium
def test_wrong_names_are_refused_with_those_that_exist(camera_only, robot, tmp_path):
    error = refused(tmp_path, camera_only, states(names=("joint_a", "joint_b", "joint_c")), robot=robot)
    assert error.facts == {"missing": "a, b, c", "recorded": "joint_a, joint_b, joint_c"}
    assert "names: {joint_a: a, joint_b: b, joint_c: c}" in error.hint
    names = {"joint_a": "a", "joint_b": "b", "joint_c": "c"}
    found = RuleRunner(tmp_path / "named").run(
        "capture.recorded_views",
        stream=camera_only,
        states=separate(tmp_path, states(names=tuple(names))),
        robot=robot,
        options={"names": names},
    )
    assert found.joints.names == NAMES


def test_recordings_of_other_times_are_refused(camera_only, tmp_path):
    late = states(stamps=states().stamps + 3600)
    error = refused(tmp_path, camera_only, late)
    assert "not recorded at the same time" in error.message
    assert float(error.facts["apart"].split()[0]) == pytest.approx(3600 - LENGTH, abs=0.3)


def test_a_gap_in_the_joint_states_is_no_rest(camera_only, tmp_path):
    whole = states()
    second = (whole.stamps - START - OFFSET > 1.9) & (whole.stamps - START - OFFSET < 2.75)
    torn = states(stamps=whole.stamps[~second], positions=whole.positions[~second])
    found = RuleRunner(tmp_path).run(
        "capture.recorded_views",
        stream=camera_only,
        states=separate(tmp_path, torn),
        options={"clock_offset_s": OFFSET},
    )
    np.testing.assert_allclose(found.joints.positions, POSTURES[[0, 2, 3, 4, 5]], atol=1e-3)
    assert found.skew_s.max() <= 0.006


def test_joint_states_far_from_every_picture_are_refused(tmp_path):
    """Joints at 7 Hz and one picture per rest: some are nearer than 20 ms, most are not."""
    few = recording(tmp_path / "few.mcap", None, rate=1.3)
    slow = states(stamps=states().stamps[::14], positions=states().positions[::14])
    runner = RuleRunner(tmp_path)
    given = {"stream": few, "states": separate(tmp_path, slow)}
    options = {"clock_offset_s": OFFSET, "skew_s": 0.02, "rest_s": 0.2}
    found = runner.run("capture.recorded_views", **given, options=options)
    assert found.skew_s.max() <= 0.02
    assert any("rests are left out" in each for each in runner.outcome.warnings)
    with pytest.raises(RuleError, match="no picture has a joint measurement near its time"):
        runner.run("capture.recorded_views", **given, options={**options, "skew_s": 1e-4})


def test_a_robot_that_never_rests_is_refused(camera_only, tmp_path):
    times = states().stamps
    swing = np.stack([np.sin(times - START), np.sin(times - START), 0.2 * times - 0.2 * START], axis=1)
    assert "never rests" in refused(tmp_path, camera_only, states(positions=swing)).message


def test_one_posture_is_flagged(camera_only, tmp_path):
    still = np.repeat(POSTURES[:1], len(states().stamps), axis=0)
    runner = RuleRunner(tmp_path)
    found = runner.run("capture.recorded_views", stream=camera_only, states=separate(tmp_path, states(positions=still)))
    assert len(found.captures) == 1
    assert any("one pose only" in each for each in runner.outcome.warnings)


@pytest.mark.medium
def test_several_cameras_come_out_of_one_recording(tmp_path, robot):
    other = CAMERA.model_copy(update={"fx": 80.0, "fy": 80.0})
    stream = recording(tmp_path / "two.mcap", states(), {"/wrist": other})
    cameras = {"front": {"image": "/camera/color/compressed"}, "wrist": {"image": "/wrist/color/compressed"}}
    found = RuleRunner(tmp_path).run(
        "capture.recorded_cameras", stream=stream, robot=robot, options={"cameras": cameras, "clock_offset_s": OFFSET}
    )
    assert {name: each.captures[f"{name}_01"].photograph.camera.fx for name, each in found.items.items()} == {
        "front": 90.0,
        "wrist": 80.0,
    }
    with pytest.raises(RuleError, match="pictures on 2 topics"):
        RuleRunner(tmp_path / "one").run("capture.recorded_views", stream=stream)


def test_a_realsense_bag_and_the_joints_of_a_robot(tmp_path, robot):
    """The camera's bag has no joints and the clock of another computer; its depth is in its own unit."""
    pytest.importorskip("rosbags", reason="needs rosbags (extra `recordings`)")
    colour, depth = "/device_0/sensor_1/Color_0/image/data", "/device_0/sensor_0/Depth_0/image/data"
    counts = {stamp: np.full((72, 96), 2400, np.uint16) for stamp in frames()}
    bag = Bag(tmp_path / "a.bag").pictures(colour, frames()).pictures(depth, counts, "mono16")
    bag.lens("/device_0/sensor_1/Color_0/info/camera_info", CAMERA, START)
    bag.lens("/device_0/sensor_0/Depth_0/info/camera_info", CAMERA, START)
    bag.number("/device_0/sensor_0/option/Depth_Units/value", 0.00025, START)
    runner = RuleRunner(tmp_path / "run")
    stream = runner.run("capture.bag", file=File.of(bag.write()))
    found = runner.run(
        "capture.recorded_views",
        stream=stream,
        states=separate(tmp_path, states()),
        robot=robot,
        options={"depth": depth},
    )
    np.testing.assert_allclose(found.joints.positions, POSTURES, atol=1e-3)
    np.testing.assert_allclose(found.captures["view_03"].measured.depth.depth, 0.6, rtol=1e-5)


def test_depth_of_a_realsense_camera_is_registered_by_its_extrinsics(tmp_path):
    """A wall at 0.6 m before the depth camera, which looks 10 mm ahead of the colour camera and has a wider view."""
    pytest.importorskip("rosbags", reason="needs rosbags (extra `recordings`)")
    top = "/device_0/sensor_"
    colour, depth = f"{top}1/Color_0/image/data", f"{top}0/Depth_0/image/data"
    few = dict(list(frames().items())[:40])
    counts = np.full((60, 90), 2400, np.uint16)
    counts[:, :45] = 1600  # its left half is nearer
    wide = Camera(width=90, height=60, fx=60.0, fy=60.0, cx=44.5, cy=29.5)
    ahead = np.eye(4)
    ahead[:3, 3] = [0.02, 0.0, 0.01]
    bag = Bag(tmp_path / "a.bag").pictures(colour, few).joints("/joint_states", states())
    bag.pictures(depth, dict.fromkeys(few, counts), "mono16")
    bag.lens(f"{top}1/Color_0/info/camera_info", CAMERA, START).lens(f"{top}0/Depth_0/info/camera_info", wide, START)
    bag.number(f"{top}0/option/Depth_Units/value", 0.00025, START)
    bag.transform(f"{top}0/Depth_0/tf/0", np.eye(4), START).transform(f"{top}1/Color_0/tf/0", ahead, START)
    runner = RuleRunner(tmp_path / "run")
    stream = runner.run("capture.bag", file=File.of(bag.write()))
    found = runner.run("capture.recorded_views", stream=stream, options={"depth": depth, "clock_offset_s": OFFSET})
    seen = found.captures["view_01"].measured.depth.depth
    assert seen.shape == (72, 96)
    np.testing.assert_allclose(seen[36, [5, 30, 90]], [0.41, 0.41, 0.61], atol=1e-4)
    # The step is at x = 0 of the depth camera, 20 mm right of the colour camera's axis.
    edge = int(np.flatnonzero(np.diff(seen[36]) > 0.1)[-1])
    assert abs(edge - (CAMERA.cx + CAMERA.fx * 0.02 / 0.41)) < 2.0


def test_depth_of_another_camera_is_refused(tmp_path):
    pytest.importorskip("rosbags", reason="needs rosbags (extra `recordings`)")
    colour, depth = "/device_0/sensor_1/Color_0/image/data", "/device_0/sensor_0/Depth_0/image/data"
    few = dict(list(frames().items())[:40])
    bag = Bag(tmp_path / "a.bag").pictures(colour, few).joints("/joint_states", states())
    bag.pictures(depth, {stamp: np.full((72, 96), 2400, np.uint16) for stamp in few}, "mono16")
    bag.lens("/device_0/sensor_1/Color_0/info/camera_info", CAMERA, START)
    wide = CAMERA.model_copy(update={"fx": 60.0, "fy": 60.0})
    bag.lens("/device_0/sensor_0/Depth_0/info/camera_info", wide, START)
    runner = RuleRunner(tmp_path / "run")
    stream = runner.run("capture.bag", file=File.of(bag.write()))
    with pytest.raises(RuleError, match="is not registered to the pictures"):
        runner.run("capture.recorded_views", stream=stream, options={"depth": depth, "clock_offset_s": OFFSET})


def test_degrees_are_flagged_without_a_model_too(camera_only, tmp_path):
    runner = RuleRunner(tmp_path)
    degrees = separate(tmp_path, states(positions=np.degrees(states().positions)))
    options = {"clock_offset_s": OFFSET, "still_rad_s": 0.6}
    runner.run("capture.recorded_views", stream=camera_only, states=degrees, options=options)
    assert any("is that in degrees" in each for each in runner.outcome.warnings)
