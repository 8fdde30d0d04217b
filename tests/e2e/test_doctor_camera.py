"""`dxb robot doctor --calibration`: a frame of the robot's camera against its calibration."""

from __future__ import annotations

import argparse
import io
import json
import threading
import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("rosbags", reason="needs rosbags (extra `ros`)")

from dextera_build.artifacts.robots.ros_names import RosNames
from dextera_build.cli.robot import drift
from dextera_build.deploying import topics as tables
from dextera_build.deploying import tracking
from dextera_build.deploying.loopback import Bus, Loopback
from dextera_build.deploying.stream import Sample, Stream
from dextera_build.formats.ros import hashes, messages
from dextera_build.geometry import lie, transforms
from dextera_build.sim.model import forward
from tests.e2e.robots import NAMES, SEEING, STORED, built, ended, started, stored
from tests.e2e.space import Space
from tests.geometry import hand_eyes
from tests.geometry.hand_eyes import Errors
from tests.rules.align.calibration import boards
from tests.rules.reference.posed import worlds

PLACES = np.array([0.4, -0.3, 0.7, 0.2])
"""Joints of the frame that the doctor takes [rad]."""
BOARD = boards.MARKER
AWAY = transforms.rigid(lie.rotation(np.array([0.0, 0.0175, 0.0])), np.array([0.02, 0.0, 0.0]))
ROBOT = """
summary: The robot of the calibration.
inputs: {stored: data/robot.json}
nodes:
  robot: {rule: demo.arm, stored: $stored}
targets: {default: [robot]}
"""


def captured(space: Space) -> np.ndarray:
    """Write a capture of nine views, and return T_camera_board of a frame in which the arm is at `PLACES`."""
    views, _, _ = hand_eyes.simulate(
        4, 10, board=boards.corners(BOARD), errors=Errors(0.0, 2e-4, 3e-4), k=boards.CAMERA.matrix(), away=False
    )
    arm = worlds.robot()
    palm = forward.frames(arm, [joint.name for joint in arm.joints], PLACES[None], "palm")[0]
    base = palm @ transforms.invert(views[9].effector)
    entries = []
    for number, view in enumerate(views[:9]):
        Image.fromarray(boards.drawn(BOARD, view.candidates[0], number)).save(
            space.write(f"before/rgb_{number}.png", "")
        )
        effector = base @ view.effector
        turn = lie.rotation_vector(effector[:3, :3]).tolist()
        stated = {"t_m": effector[:3, 3].tolist(), "rotvec_rad": turn}
        entries.append({"rgb": f"rgb_{number}.png", "T_base_ee": stated})
    target = {"type": "AprilTag 36h11", "size_m": BOARD.square_m, "mounted": "gripper"}
    facts = {**boards.CAMERA.model_dump(), "setup": "eye-to-hand", "effector_frame": "palm", "target": target}
    space.write("before/capture.json", json.dumps(facts | {"views": entries}))
    return np.asarray(views[9].candidates[0])


def frame(pose: np.ndarray | None) -> tuple[Any, Loopback, Any]:
    """A cell that received a frame, its transport, and its topics; None: of an empty table."""
    bus = Bus()
    here, robot, arm = Loopback(bus), Loopback(bus), worlds.robot()
    topics = tables.of_robot(arm, RosNames(), ("workspace",))
    size = boards.CAMERA.height, boards.CAMERA.width
    pixels = np.full((*size, 3), 90, np.uint8) if pose is None else boards.drawn(BOARD, pose, 9)
    png = io.BytesIO()
    Image.fromarray(pixels).save(png, "png")
    kind = topics.pictures["workspace"].kind
    shown = hashes.read(kind, messages.compressed_image(5, "camera", "png", png.getvalue()))
    picture, state = Stream("picture"), Stream("state")
    picture.add(Sample(5, 5, shown))
    for stamp, places in ((1, np.zeros(4)), (5, PLACES), (9, np.zeros(4))):
        state.add(Sample(stamp, stamp, places))
    info = tracking.info_of(topics, "workspace")
    lens = messages.camera_info(5, "camera", boards.CAMERA)

    def tell() -> None:
        for _ in range(50):
            robot.publish(tables.offered(info), lens)
            time.sleep(0.1)

    threading.Thread(target=tell, daemon=True).start()
    return SimpleNamespace(pictures={"workspace": picture}, state=state), here, topics


@pytest.mark.slow
def test_a_frame_tells_whether_the_camera_was_moved(space: Space, monkeypatch: pytest.MonkeyPatch) -> None:
    there = captured(space)
    rule = STORED.replace("NAME", "arm").replace("tasks.task import KIND", "robots.robot import RobotModel")
    space.write("rules/demo/arm.py", rule.replace("KIND", "RobotModel").lstrip())
    space.write("data/robot.json", stored(worlds.robot()))
    space.write("recipes/robot/arm.yaml", ROBOT)
    monkeypatch.chdir(space.root)
    args = argparse.Namespace(
        calibration="capture/camera_moved:moved",
        calibrated=["capture=before", "robot=robot/arm:robot"],
        camera="workspace",
        settings=[],
        backends=[],
    )

    def check(pose: np.ndarray | None) -> Any:
        cell, transport, topics = frame(pose)
        (found,) = drift.checks(args, transport, topics, cell, worlds.robot())
        return found

    still = check(there)
    assert (still.ok, still.found.split(":")[0]) == (True, "unmoved"), still
    moved = check(transforms.invert(AWAY) @ there)
    assert (moved.ok, moved.found.split(":")[0]) == (False, "moved")
    assert "calibrate it again" in moved.mend
    nothing = check(None)
    assert not nothing.ok
    assert "mount the board" in nothing.mend
    assert drift.checks(argparse.Namespace(calibration=None), None, None, None, None) == ()  # type: ignore[arg-type]


@pytest.mark.slow
def test_the_doctor_fails_if_no_board_is_in_the_picture(space: Space) -> None:
    pytest.importorskip("cyclonedds", reason="needs cyclonedds (extra `ros`)")
    built(space)
    captured(space)
    robot = started(space, *SEEING)
    try:
        inputs = ("--input", "capture=before", "--input", "robot=task/try:robot")
        asked = ("--calibration", "capture/camera_moved:moved", *inputs)
        done = space.dxb("robot", "doctor", "task/try", *NAMES, *SEEING, *asked, "--json")
    finally:
        ended(robot)
    assert done.code == 1, done.err
    failed = [each for each in done.document["checks"] if not each["ok"]]
    assert [each["check"] for each in failed] == [drift.WHAT]
