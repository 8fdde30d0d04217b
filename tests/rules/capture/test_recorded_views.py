"""Views out of recordings: moments of rest, clocks, and joint states that are not those of the robot."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from dextera_build.artifacts.base import File
from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.robot import RobotModel
from dextera_build.artifacts.ros import messages
from dextera_build.artifacts.ros.recording import Recording, packed
from dextera_build.artifacts.stream import Joints, Stream
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from rules.capture.robot.moved import places
from tests.rules.capture.bags import Bag

START = 1.7e9
CAMERA = Camera(width=96, height=72, fx=90.0, fy=90.0, cx=47.5, cy=35.5)
NAMES = ("a", "b", "c")
POSTURES = np.array(
    [[0.1, 0.4, 0.2], [0.7, 0.9, -0.3], [-0.6, 1.3, 0.5], [1.2, 0.2, 0.9], [-1.1, 1.0, -0.8], [0.4, 1.8, 1.1]]
)
"""Where the robot rests; the limits of its joints differ, so that no other order fits."""
LIMITS = {"a": (-1.4, 1.4), "b": (0.1, 2.4), "c": (-0.9, 1.2)}
OFFSET = 0.16
"""How far the robot's clock is ahead of the camera's [s]."""


def postures(times: np.ndarray) -> np.ndarray:
    """(N, 3) joint positions at times since the start: rests of 1 s, and motions of 0.7 to 1.2 s."""
    found = np.repeat(POSTURES[:1], len(times), axis=0)
    start = 1.0
    for number in range(1, len(POSTURES)):
        length = 0.7 + 0.1 * number
        part = np.clip((times - start) / length, 0.0, 1.0)[:, None]
        found = found + (part * part * (3 - 2 * part)) * (POSTURES[number] - POSTURES[number - 1])
        start += length + 1.0
    return found


LENGTH = 1.0 + sum(0.7 + 0.1 * n for n in range(1, 6)) + 5.0


@functools.cache
def backdrop() -> np.ndarray:
    random = np.random.default_rng(0)
    return np.clip(ndimage.gaussian_filter(random.normal(0, 1, (300, 400)), 2) * 400 + 120, 0, 255)


def picture(posture: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A textured patch that moves with the joints before a texture that does not."""
    found = backdrop()[:72, :96].copy()
    column, row = int(30 + 14 * posture[0] + 6 * posture[2]), int(10 + 12 * posture[1])
    found[row : row + 24, column : column + 24] = backdrop()[200 : 200 + 24, 200 : 200 + 24][:, ::-1]
    noisy = found + random.normal(0, 2.0, found.shape)
    return np.repeat(np.clip(noisy, 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def states(**changes: Any) -> Joints:
    """Joint states at 100 Hz on the robot's clock."""
    random = np.random.default_rng(1)
    times = np.arange(0.0, LENGTH, 0.01)
    positions = postures(times) + random.normal(0, 1e-4, (len(times), 3))
    found = {"names": NAMES, "stamps": START + OFFSET + times, "positions": positions, **changes}
    return Joints(**found)


@functools.cache
def frames(rate: float = 30.0) -> dict[float, np.ndarray]:
    """Pictures on the camera's clock."""
    random = np.random.default_rng(2)
    times = np.arange(0.02, LENGTH - 0.02, 1 / rate)
    return {START + float(time): picture(row, random) for time, row in zip(times, postures(times), strict=True)}


def recording(path: Path, joints: Joints | None, more: dict[str, Camera] | None = None, rate: float = 30.0) -> Stream:
    """An MCAP recording with one camera per name."""
    with path.open("wb") as out, Recording(out) as file:
        for name, camera in {"/camera": CAMERA, **(more or {})}.items():
            stamp = round(START * 1e9)
            file.send(f"{name}/camera_info", "sensor_msgs/CameraInfo", stamp, messages.camera_info(stamp, "c", camera))
            for time, pixels in frames(rate).items():
                stamp = round(time * 1e9)
                message = messages.compressed_image(stamp, "c", "png", packed(pixels, "png"))
                file.send(f"{name}/color/compressed", "sensor_msgs/CompressedImage", stamp, message)
        if joints is not None:
            for time, row in zip(joints.stamps, joints.positions, strict=True):
                stamp = round(float(time) * 1e9)
                file.send(
                    "/joint_states", "sensor_msgs/JointState", stamp, messages.joint_state(stamp, joints.names, row)
                )
    return Stream.load(path)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    """Three hinges about different axes."""
    axes = {"a": (0, 0, 1), "b": (0, 1, 0), "c": (1, 0, 0)}
    piece = {"shape": "box", "half_m": (0.02, 0.02, 0.08), "colour": "grey"}
    matter = {"mass_kg": 1.0, "centre_m": (0, 0, 0), "inertia_kgm2": (0.01, 0.01, 0.01), "pieces": [piece]}
    motor = {"velocity_rad_s": 3.0, "effort_nm": 50, "stiffness_nm_rad": 100, "damping_nms_rad": 10}
    links = [{"name": "base", **matter}]
    for name, axis in axes.items():
        low, high = LIMITS[name]
        joint = {"name": name, "axis": axis, "lower_rad": low, "upper_rad": high, "home_rad": 0.2, **motor}
        links.append({"name": f"link_{name}", "at_m": (0.05, 0, 0.2), "joint": joint, **matter})
    options = {
        "name": "three",
        "source": "the test",
        "colours": {"grey": (0.5, 0.5, 0.5)},
        "chains": [{"group": "arm", "mounts": [{}], "links": links}],
        "frames": {"flange": {"link": "link_c", "at_m": (0, 0, 0.1)}},
    }
    runner = RuleRunner(tmp_path_factory.mktemp("robot"))
    model: RobotModel = runner.run("simulate.robot", options=options)
    return model


@pytest.fixture(scope="module")
def stream(tmp_path_factory: pytest.TempPathFactory) -> Stream:
    return recording(tmp_path_factory.mktemp("recording") / "a.mcap", states())


@pytest.fixture(scope="module")
def camera_only(tmp_path_factory: pytest.TempPathFactory) -> Stream:
    return recording(tmp_path_factory.mktemp("recording") / "b.mcap", None)


def separate(path: Path, joints: Joints) -> Stream:
    return Stream.record(path / "states.mcap", joints={"/joint_states": joints})


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
    assert "taken as the same" in runner.outcome.warnings[0]


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
    with pytest.raises(RuleError, match="no picture has a joint measurement beside it"):
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


def poses_of(robot: RobotModel, joints: Joints) -> np.ndarray:
    """Poses of the flange, with a tool and a base elsewhere."""
    return places(robot, joints.names, joints.positions, "flange")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda rows: rows, ""),
        (lambda rows: rows[:, [0, 2, 1]], "`b` and `c` swapped"),
        (lambda rows: rows * [-1, 1, 1], "sign of `a` changed"),
    ],
)
def test_joints_that_do_not_give_the_recorded_poses_are_refused(robot, tmp_path, change, says):
    """Where limits tell nothing, poses do."""
    from rules.capture.robot import moved

    joints = Joints(names=NAMES, stamps=np.arange(6.0), positions=POSTURES)
    wrong = joints.model_copy(update={"positions": np.ascontiguousarray(change(POSTURES))})
    recorded = poses_of(robot, joints)

    class Refusing:
        def fail(self, message: str, **facts: Any) -> None:
            raise RuleError(message, code="DXB-B202", facts=facts)

    if not says:
        moved.check_poses(Refusing(), robot, wrong, recorded, "flange")
        return
    with pytest.raises(RuleError) as caught:
        moved.check_poses(Refusing(), robot, wrong, recorded, "flange")
    assert says in caught.value.message
    assert "deg in the median over 15 pairs" in caught.value.facts["turns"]


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
