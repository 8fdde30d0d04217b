"""Errors of scene alignments: posed views as captures, one of them as a scene, fits against the truth."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.scenes.scene_fit import SceneEvidence, SceneFit
from dextera_build.artifacts.spatial.pose import Similarity
from dextera_build.errors import RuleError
from dextera_build.geometry import transforms
from dextera_build.testing import RuleRunner
from tests.installed import needs
from tests.rules.align import painted

needs("open3d")

POSES = {
    0: painted.motion((0, 0, 0), (1.0, 2.0, 3.0)),
    7: painted.motion((0, 10, 5), (1.2, 2.0, 3.1)),
    9: painted.motion((3, -10, 0), (0.8, 2.1, 3.0)),
}
FACTOR = 0.37
EVIDENCE = SceneEvidence(
    pairs=90,
    inliers=80,
    spread=1.0,
    overlap=0.8,
    agreement=0.9,
    in_front=0.0,
    correlation=0.9,
    residual_px=0.5,
    residual_m=0.005,
    condition=100.0,
)


@pytest.fixture(scope="module")
def views() -> Folder:
    """Three views of the painted room, whose world is elsewhere."""
    files, listed = {}, []
    for frame, pose in POSES.items():
        shot = painted.capture(painted.room(), transforms.invert(POSES[0]) @ pose, noise=0.0)
        assert shot.measured is not None
        depth = np.round(1000 * shot.measured.depth.depth).astype(np.uint16)
        for name, pixels in ((f"{frame}.png", shot.photograph.rgb.pixels), (f"{frame}.depth.png", depth)):
            buffer = io.BytesIO()
            Picture.fromarray(pixels).save(buffer, "PNG")
            files[name] = buffer.getvalue()
        place = {"frame": frame, "rgb": f"{frame}.png", "depth": f"{frame}.depth.png", "T_world_camera": pose.tolist()}
        listed.append(place)
    facts = {**painted.CAMERA.model_dump(), "depth_scale_m": 0.001, "views": listed}
    files["views.json"] = json.dumps(facts).encode()
    files["capture.json"] = json.dumps({"frame": 0}).encode()
    return Folder(files=files)


def fit(frame: int, aside_m: float = 0.0, doubts: tuple[str, ...] = ()) -> SceneFit:
    """A fit whose camera is `aside_m` to the right of where it was."""
    matrix = transforms.invert(POSES[frame]) @ POSES[0]
    matrix[0, 3] -= aside_m
    motion = Similarity(parent="camera", child="scene", matrix=matrix, scale=1 / FACTOR, covariance=1e-6 * np.eye(7))
    return SceneFit(motion=motion, evidence=EVIDENCE, doubts=doubts)


def test_errors_and_medians(tmp_path: Path, views: Folder) -> None:
    runner = RuleRunner(tmp_path)
    fits = Collection[SceneFit](items={"view_7": fit(7, 0.02), "view_9": fit(9, 0.08, ("too far",))})
    table = runner.run("benchmark.scene_alignment_error", fits=fits, views=views, options={"scale_factor": FACTOR})
    rows = {row[0]: row for row in table.rows}
    assert rows["view_7"][1:5] == pytest.approx((20.0, 20.0, 0.0, 0.0), abs=0.1)
    assert rows["view_9"][1] == pytest.approx(80.0, abs=0.1)
    assert (rows["view_9"][8], rows["view_9"][9]) == (False, "too far")
    assert rows["median of believed"][1] == pytest.approx(20.0, abs=0.1)
    assert rows["median of all"][1] == pytest.approx(50.0, abs=0.1)
    assert runner.outcome.line == "1 of 2 believed, 0 of these off by more than 50 mm"


def test_one_that_is_believed_and_far_off_is_counted(tmp_path: Path, views: Folder) -> None:
    runner = RuleRunner(tmp_path)
    fits = Collection[SceneFit](items={"view_9": fit(9, 0.08)})
    runner.run("benchmark.scene_alignment_error", fits=fits, views=views, options={"scale_factor": FACTOR})
    assert runner.outcome.line == "1 of 1 believed, 1 of these off by more than 50 mm"


def test_views_become_captures_without_poses(tmp_path: Path, views: Folder) -> None:
    runner = RuleRunner(tmp_path)
    found = runner.run("benchmark.view_captures", views=views, options={"frames": [9]})
    assert [*found.items] == ["view_9"]
    shot = found.items["view_9"]
    assert isinstance(shot, Capture)
    assert shot.photograph.camera == painted.CAMERA
    with pytest.raises(RuleError, match="no view `8`"):
        runner.run("benchmark.view_captures", views=views, options={"frames": [8]})


def test_a_scene_of_measured_pixels_has_another_scale(tmp_path: Path) -> None:
    shot = painted.capture(painted.room(), np.eye(4), noise=0.0)
    made = RuleRunner(tmp_path).run("reference.pixels_as_splats", capture=shot, options={"scale_factor": FACTOR})
    assert shot.measured is not None
    assert made.frame == "scene"
    assert made.means[:, 2].max() == pytest.approx(FACTOR * shot.measured.depth.depth.max(), rel=0.01)
    assert 0.5 * shot.measured.depth.depth.size < len(made.means) < shot.measured.depth.depth.size
