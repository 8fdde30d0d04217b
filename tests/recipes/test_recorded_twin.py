"""twin/from_recording with real backends: a camera on its side, whose inertial sensor tells what is up."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.api import Project
from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.objects.object import Asset, Support
from dextera_build.geometry import lie, transforms
from tests import factories, tabletops
from tests.e2e.space import Space
from tests.rules.capture.bags import Bag

pytest.importorskip("rosbags", reason="needs rosbags (extra `recordings`)")
pytestmark = pytest.mark.slow

START_S, PICTURES, READINGS = 1.7e9, 9, 180
SIDES_M = (0.06, 0.1, 0.14)
EYE = tabletops.EYE @ transforms.rigid(lie.about_z(np.pi / 2), np.zeros(3))
"""T_world_camera: the picture's x axis points down."""
MOUNT = transforms.rigid(lie.rotation(np.array([0.4, -1.2, 2.0])), np.array([0.02, 0.0, -0.01]))
"""T_camera_imu."""
COLOUR, DEPTH = "/camera/color", "/camera/aligned_depth_to_color"


def recording(path: Path) -> Path:
    """A bag of ROS 2 as a camera at rest records it: the same picture nine times, and its accelerometer."""
    box = tabletops.box(SIDES_M[1], SIDES_M[0], SIDES_M[2], (0.75, 0.1, 0.1)), factories.pose(0.05, 0.0, yaw=0.3)
    shot = tabletops.tabletop(box, eye=EYE, lens=tabletops.FINE).capture
    assert shot.measured is not None
    counts = np.round(1000 * shot.measured.depth.depth).astype(np.uint16)
    stamps = [START_S + 0.1 * number for number in range(PICTURES)]
    up = (EYE @ MOUNT)[:3, :3].T @ [0.0, 0.0, 9.81]
    noise = np.random.default_rng(1).normal(0, 0.05, (READINGS, 3))
    bag = Bag(path).pictures(f"{COLOUR}/image_raw", dict.fromkeys(stamps, shot.photograph.rgb.pixels))
    bag.lens(f"{COLOUR}/camera_info", tabletops.FINE, START_S)
    bag.pictures(f"{DEPTH}/image_raw", dict.fromkeys(stamps, counts), "mono16")
    bag.lens(f"{DEPTH}/camera_info", tabletops.FINE, START_S)
    bag.accelerations("/imu/data", "imu", {START_S + 0.005 * n: up + noise[n] for n in range(READINGS)})
    return bag.frames("/tf_static", {("camera", "imu"): MOUNT}, START_S).write()


def test_a_recording_becomes_a_twin_that_stands_as_gravity_tells(tmp_path: Path) -> None:
    space = Space(tmp_path)
    space.write("dxb.toml", 'cache = "cache"\n')
    bag = recording(tmp_path / "bag")
    answer = space.build("twin/from_recording", "--input", f"recording={bag}")
    assert answer.code == 0, answer.err[-3000:]
    lines = {event["node"]: event["line"] for event in answer.events if event["event"] == "node_finished"}
    assert lines["settle"].startswith("settles")
    project = Project.find(tmp_path)
    photo, support, asset = (
        project.get(f"twin/from_recording:{node}", inputs={"recording": bag})
        for node in ("photo", "support", "body[red_box].asset")
    )
    assert isinstance(photo, Capture)
    assert photo.measured is not None
    assert photo.photograph.gravity is not None
    down = EYE[:3, :3].T @ [0.0, 0.0, -1.0]
    assert np.degrees(np.arccos(min(1.0, float(photo.photograph.gravity @ down)))) < 0.2
    assert isinstance(support, Support)
    found = support.camera_pose.matrix
    assert np.degrees(np.arccos(min(1.0, float(found[2, :3] @ -down)))) < 0.5
    assert found[2, 3] == pytest.approx(EYE[2, 3], abs=0.003)
    assert isinstance(asset, Asset)
    assert np.sort(asset.body.links["base"].mesh.extent) == pytest.approx(SIDES_M, abs=0.005)
