"""capture.rgbd: a folder in the form of `views.json`, a recording, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.image import png
from dextera_build.artifacts.cameras.rgbd_video import RgbdVideo
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests.formats.test_rgbd_video import CAMERA, frames, recording

TOPICS = {"colour_topic": "/colour", "depth_topic": "/depth", "info_topic": "/info"}


@pytest.fixture
def runner(tmp_path: Path) -> RuleRunner:
    return RuleRunner(tmp_path)


def folder(**changed: object) -> Folder:
    files, views = {}, []
    for number, frame in enumerate(frames()):
        files[f"views/{number}.png"] = png(frame.rgb)
        files[f"views/{number}.depth.png"] = png(np.round(frame.depth * 1000).astype(np.uint16))
        pose = None if frame.pose is None else frame.pose.tolist()
        names = {"rgb": f"views/{number}.png", "depth": f"views/{number}.depth.png"}
        views.append({"frame": 260 + 10 * number, **names, "T_world_camera": pose})
    said = {**CAMERA.model_dump(), "depth_scale_m": 0.001, "views": views, **changed}
    return Folder(files={**files, "views.json": json.dumps(said).encode()})


def test_a_folder_gives_frames_with_times_and_poses(runner: RuleRunner):
    found: RgbdVideo = runner.run("capture.rgbd", source=folder())
    assert found.stamps == pytest.approx([260 / 30, 270 / 30, 280 / 30])
    for made, frame in zip(found.frames(), frames(), strict=True):
        assert np.array_equal(made.rgb, frame.rgb)
        assert np.abs(made.depth - frame.depth).max() <= 0.00051
        assert np.array_equal(made.pose, frame.pose)


def test_a_recording_gives_pairs_of_colour_and_depth(runner: RuleRunner, tmp_path: Path):
    stream = recording(tmp_path / "a.mcap", "mm")
    found: RgbdVideo = runner.run("capture.rgbd", source=stream, options=TOPICS)
    assert found.camera == CAMERA
    assert found.stamps == pytest.approx([frame.stamp + 1 for frame in frames()])
    assert all(np.array_equal(made.rgb, frame.rgb) for made, frame in zip(found.frames(), frames(), strict=True))


def test_pictures_without_a_partner_in_time_are_left_out(runner: RuleRunner, tmp_path: Path):
    """Row 6 of bad input: unsynchronised pictures are no frames."""
    stream = recording(tmp_path / "a.mcap", "mm")
    with pytest.raises(Exception, match="it has no frame"):
        runner.run("capture.rgbd", source=stream, options={**TOPICS, "apart_s": 0.001})


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"views": [{"rgb": "a.png"}]}, "cannot be read"),
        ({"fx": "wide"}, "cannot be read|Camera.fx"),
        ({"views": [{"frame": 1, "rgb": "a.png", "depth": "b.png"}]}, "`a.png` is missing"),
    ],
)
def test_a_damaged_list_is_refused(runner: RuleRunner, changed: dict[str, object], message: str):
    with pytest.raises(Exception, match=message):
        runner.run("capture.rgbd", source=folder(**changed))


def test_a_folder_without_a_list_is_refused(runner: RuleRunner):
    with pytest.raises(RuleError, match=r"`views.json` is missing"):
        runner.run("capture.rgbd", source=Folder(files={"a.txt": b""}))
