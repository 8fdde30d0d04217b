"""capture.recorded_picture: a picture of a bag, with depth and gravity, however the inertial sensor is mounted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import File, Folder
from dextera_build.artifacts.cameras.camera import Camera, Capture
from dextera_build.errors import RuleError
from dextera_build.geometry import lie, transforms
from dextera_build.testing import RuleRunner
from tests.rules.capture.bags import Bag, files

pytest.importorskip("rosbags", reason="needs rosbags (extra `recordings`)")

START = 1.7e9
CAMERA = Camera(width=32, height=24, fx=40.0, fy=40.0, cx=15.5, cy=11.5)
FRAMES = {START + 0.1 * n: np.random.default_rng(n).integers(0, 256, (24, 32, 3), dtype=np.uint8) for n in range(9)}
DOWN = np.array([0.1, 0.8, 0.6]) / np.linalg.norm([0.1, 0.8, 0.6])
"""Gravity in the frame of the camera."""
MOUNTED = transforms.rigid(lie.rotation(np.array([0.4, -1.2, 2.0])), np.array([0.02, 0.0, -0.01]))
"""T_camera_imu."""
IMAGE, DEPTH, INFO = "/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw", "/camera/color/camera_info"


def readings(turn: np.ndarray, noise: float = 0.05, bias: float = 0.0) -> dict[float, np.ndarray]:
    """What an accelerometer with these axes, R_camera_imu, reads at 200 Hz: the direction up, with noise [m/s^2]."""
    random = np.random.default_rng(1)
    up = -9.81 * turn.T @ DOWN + bias
    return {START + 0.005 * n: up + random.normal(0, noise, 3) for n in range(180)}


def seen(path: Path, depth: bool = True) -> Bag:
    made = Bag(path).pictures(IMAGE, FRAMES).lens(INFO, CAMERA, START)
    counts = {stamp: np.full((24, 32), 700 + n, np.uint16) for n, stamp in enumerate(FRAMES)}
    return made.pictures(DEPTH, counts, "mono16").lens(f"{DEPTH[:-9]}camera_info", CAMERA, START) if depth else made


def taken(bag: Bag, tmp_path: Path, **options: object) -> tuple[Capture, list[str]]:
    runner = RuleRunner(tmp_path / "run")
    path = bag.write()
    stream = runner.run("capture.bag", file=Folder(files=dict(files(path))) if path.is_dir() else File.of(path))
    capture: Capture = runner.run("capture.recorded_picture", stream=stream, options=options)
    return capture, list(runner.outcome.warnings)


def off_deg(capture: Capture) -> float:
    assert capture.photograph.gravity is not None
    return float(np.degrees(np.arccos(np.clip(capture.photograph.gravity @ DOWN, -1.0, 1.0))))


def test_the_same_frame_needs_no_transform(tmp_path):
    bag = seen(tmp_path / "a.bag").accelerations("/camera/imu", "camera", readings(np.eye(3)))
    capture, warnings = taken(bag, tmp_path)
    assert off_deg(capture) < 0.1
    np.testing.assert_array_equal(capture.photograph.rgb.pixels, list(FRAMES.values())[4])
    np.testing.assert_allclose(capture.measured.depth.depth, 0.704, atol=1e-6)
    assert not any("gravity" in each for each in warnings)


def test_static_transforms_tell_how_it_is_mounted(tmp_path):
    link = transforms.rigid(lie.rotation(np.array([1.0, 0.3, -0.5])), np.zeros(3))
    edges = {("link", "camera"): link, ("link", "board"): link @ MOUNTED, ("board", "imu"): np.eye(4)}
    bag = seen(tmp_path / "bag").accelerations("/imu/data", "imu", readings(MOUNTED[:3, :3]))
    capture, _ = taken(bag.frames("/tf_static", edges, START), tmp_path)
    assert off_deg(capture) < 0.1


def test_the_extrinsics_of_a_realsense_recording_do_so_too(tmp_path):
    colour, sensor = "/device_0/sensor_1/Color_0", "/device_0/sensor_2/Accel_0"
    reference = transforms.rigid(lie.rotation(np.array([0.2, 0.1, 0.0])), np.zeros(3))
    bag = Bag(tmp_path / "a.bag").pictures(f"{colour}/image/data", FRAMES)
    bag.pictures(
        "/device_0/sensor_0/Depth_0/image/data", {s: np.full((24, 32), 700, np.uint16) for s in FRAMES}, "mono16"
    )
    bag.lens(f"{colour}/info/camera_info", CAMERA, START).transform(f"{colour}/tf/0", reference, START)
    bag.lens("/device_0/sensor_0/Depth_0/info/camera_info", CAMERA, START)
    bag.transform("/device_0/sensor_0/Depth_0/tf/0", np.eye(4), START)
    bag.transform(f"{sensor}/tf/0", transforms.invert(MOUNTED) @ reference, START)
    capture, _ = taken(bag.accelerations(f"{sensor}/imu/data", "accel", readings(MOUNTED[:3, :3])), tmp_path)
    assert off_deg(capture) < 0.1


def test_an_unknown_mount_is_told(tmp_path):
    bag = seen(tmp_path / "a.bag").accelerations("/imu/data", "imu", readings(np.eye(3)))
    capture, warnings = taken(bag, tmp_path)
    assert capture.photograph.gravity is None
    assert any("/tf_static" in each and "`imu`" in each for each in warnings)


@pytest.mark.parametrize(("noise", "bias"), [(2.0, 0.0), (0.05, 3.0), (0.0, 0.15)], ids=["shaken", "pushed", "at rest"])
def test_only_a_camera_at_rest_has_gravity(noise, bias, tmp_path):
    bag = seen(tmp_path / "a.bag").accelerations("/camera/imu", "camera", readings(np.eye(3), noise, bias))
    capture, warnings = taken(bag, tmp_path)
    if bias < 1.0 > noise:
        assert off_deg(capture) < 1.5
    else:
        assert capture.photograph.gravity is None
        assert any("it was moved" in each for each in warnings)


def test_a_time_is_chosen_and_a_late_one_refused(tmp_path):
    bag = seen(tmp_path / "a.bag", depth=False)
    capture, _ = taken(bag, tmp_path, at_s=0.21)
    np.testing.assert_array_equal(capture.photograph.rgb.pixels, list(FRAMES.values())[2])
    assert capture.measured is None
    with pytest.raises(RuleError, match=r"0\.8 s after the first one"):
        taken(seen(tmp_path / "late.bag", depth=False), tmp_path / "late", at_s=5.0)
