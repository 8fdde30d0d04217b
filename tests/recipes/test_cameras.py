"""capture/cameras as a user types it: two cameras before a robot that holds a board, calibrated from one recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build import Project
from dextera_build.artifacts.cameras.calibration import Calibration
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.formats.ros import messages
from dextera_build.formats.ros.recording import Recording, packed
from dextera_build.geometry import transforms

REST_S, MOVE_S, START = 1.0, 6.0, 1.7e9
RECIPE = """
summary: Pictures of two cameras beside the robot of a simulated cell.
inputs:
  robot: robot/kuka_leap
nodes:
  world:
    rule: reference.world
    camera: {width_px: 640, height_px: 360, fx_px: 456, fy_px: 456, cx_px: 321, cy_px: 180,
             eye_m: [0.04, -0.80, 0.72], target_m: [0.04, 0.02, 0.07]}
    objects: {}
    lamps: [{direction: [0.45, 0.55, -1.0], strength: 0.6}]
    robot: {position_m: [0.14, 0.58, -0.02], yaw_deg: 272,
            joints_deg: {joint_1: 27, joint_2: 2, joint_4: -113, joint_6: 65, joint_7: 60}}
  beside: {rule: reference.move_camera, world: $world, shift_m: [0.06, 0.02, 0.01], turn_deg: [1, -2, 3]}
  postures: {rule: reference.postures, world: $world, robot: $robot, count: 6, seed: 5}
  front: {rule: reference.robot_views, world: $world, robot: $robot, postures: $postures, count: 6, seed: 5}
  side: {rule: reference.robot_views, world: $beside, robot: $robot, postures: $postures, count: 6, seed: 5}
targets:
  default: [world, beside, front, side]
"""
TAKEN = """
summary: Both cameras.
extends: capture/cameras
nodes:
  views:
    rule: capture.recorded_cameras
    stream: $stream
    robot: $robot
    clock_offset_s: 0.0
    cameras:
      front: {image: /front/image/compressed, camera_info: /front/camera_info, board: &board BOARD}
      side: {image: /side/image/compressed, camera_info: /side/camera_info, board: *board}
"""


def record(path: Path, cameras: dict[str, RobotViews]) -> None:
    """One recording of all cameras, with a few pictures of each rest, and of the joints at 50 Hz."""
    joints = next(iter(cameras.values())).joints
    assert joints is not None
    count = len(joints.positions)
    starts = (REST_S + MOVE_S) * np.arange(count)
    knots = np.stack([starts, starts + REST_S], axis=1).reshape(-1)
    times = np.arange(0.0, knots[-1], 0.02)
    rows = np.stack([np.interp(times, knots, np.repeat(each, 2)) for each in joints.positions.T], axis=1)
    with path.open("wb") as out, Recording(out) as file:
        for time, row in zip(times, rows, strict=True):
            stamp = round((START + time) * 1e9)
            file.send("/joint_states", "sensor_msgs/JointState", stamp, messages.joint_state(stamp, joints.names, row))
        for name, views in cameras.items():
            for start, capture in zip(starts, views.captures.values(), strict=True):
                shown = capture.photograph
                for late in (0.3, 0.5, 0.7):
                    stamp = round((START + start + late) * 1e9)
                    info = messages.camera_info(stamp, name, shown.camera)
                    file.send(f"/{name}/camera_info", "sensor_msgs/CameraInfo", stamp, info)
                    taken = messages.compressed_image(stamp, name, "png", packed(shown.rgb.pixels, "png"))
                    file.send(f"/{name}/image/compressed", "sensor_msgs/CompressedImage", stamp, taken)


@pytest.mark.slow
def test_every_camera_of_a_recording_is_calibrated(tmp_path: Path) -> None:
    (tmp_path / "dxb.toml").write_text("")
    (tmp_path / "recipes").mkdir()
    (tmp_path / "recipes" / "cell.yaml").write_text(RECIPE)
    cell = Project.find(tmp_path).build("cell", profile="cpu")
    assert cell.ok, cell.errors
    views = {name: cell.artifact(name) for name in ("front", "side")}
    record(tmp_path / "session.mcap", views)
    board = views["front"].board.model_dump_json().replace('"', "").replace(":", ": ")
    (tmp_path / "recipes" / "both.yaml").write_text(TAKEN.replace("BOARD", board))
    inputs = {"recording": str(tmp_path / "session.mcap"), "robot": "robot/kuka_leap"}
    both = Project.find(tmp_path).build("both", inputs=inputs, profile="cpu")
    assert both.ok, both.errors
    truths = {}
    for name, world in (("front", "world"), ("side", "beside")):
        there = cell.artifact(world)
        truths[name] = transforms.invert(there.stand.pose().matrix) @ there.camera_pose.matrix
        found: Calibration = both.artifact(f"camera[{name}].calibration")
        assert_near(found.pose.matrix, truths[name])
    options = {
        "views.image": "/front/image/compressed",
        "views.camera_info": "/front/camera_info",
        "views.board": views["front"].board.model_dump(),
        "views.clock_offset_s": 0.0,
        "calibration.effector_frame": "flange",
    }
    alone = Project.find(tmp_path).build("capture/recorded_calibration", inputs=inputs, settings=options, profile="cpu")
    assert alone.ok, alone.errors
    assert_near(alone.artifact("calibration").pose.matrix, truths["front"])


def assert_near(found: np.ndarray, true: np.ndarray) -> None:
    """Two poses (4, 4) of a camera differ by less than what six pictures leave open."""
    assert np.linalg.norm(found[:3, 3] - true[:3, 3]) < 0.012
    assert np.degrees(transforms.angle(found[:3, :3].T @ true[:3, :3])) < 0.6
