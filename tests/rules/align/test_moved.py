"""A twin and a new photograph of it: where the camera is, and what moved."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.camera import Camera, Capture, Measured, Photograph
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.artifacts.table import Table
from dextera_build.errors import RuleError
from dextera_build.geometry import transforms
from dextera_build.testing import RuleRunner
from tests import factories
from tests.benchmarks.tracking import scene
from tests.rules.align.test_track import LENS, asset, support

SHIFT_M, TURN_DEG = 0.03, 8.0


def pose_at(time: float) -> np.ndarray:
    """The box at the time of the twin's photograph, 0, and of the new one, 1."""
    return scene.standing(-0.1 + SHIFT_M * time, 0.0, 15 + TURN_DEG * time)


def still(time: float) -> np.ndarray:
    return scene.standing(0.12, 0.05, 40)


def camera(time: float) -> np.ndarray:
    return scene.before(heading_deg=2 * time)


@pytest.fixture(scope="module")
def captures() -> list[Capture]:
    mesh = asset(np.eye(4)).body.links["base"].mesh
    actors = {"box": scene.Actor({"base": mesh}, pose_at), "other": scene.Actor({"base": mesh}, still)}
    frames = scene.frames(scene.Sequence("again", actors, camera, 2.0, 1.0, LENS))
    return [capture(frame.rgb, frame.depth, LENS) for frame, _ in frames]


def capture(rgb: np.ndarray, depth: np.ndarray, lens: Camera) -> Capture:
    photograph = Photograph(rgb=Image(pixels=rgb), camera=lens)
    return Capture(photograph=photograph, measured=Measured(depth=DepthImage(depth=depth)))


def seen_again(captures: list[Capture], place: Path, now: Pose) -> tuple[Table, str]:
    assets = Collection[Asset](items={"box": asset(pose_at(0)), "other": asset(still(0))})
    runner = RuleRunner(place)
    video = runner.run(
        "capture.pair",
        first=captures[0],
        second=captures[1],
        first_pose=support(0).camera_pose,
        second_pose=now,
    )
    options = {"camera": "stated"}
    tracks = runner.run("align.track", backend="model", video=video, assets=assets, support=support(0), options=options)
    found = runner.run("align.moved", tracking=tracks, support=support(0), camera=now)
    return found, runner.outcome.line


def test_the_box_that_was_pushed_is_told_from_the_one_that_stayed(captures, tmp_path):
    now = Pose(parent="world", child="camera", matrix=camera(1.0))
    table, line = seen_again(captures, tmp_path, now)
    rows = {row[0]: row[1:] for row in table.rows}
    between = transforms.invert(camera(0.0)) @ camera(1.0)
    assert rows["camera"][0] == pytest.approx(1000 * np.linalg.norm(between[:3, 3]), rel=1e-6)
    assert rows["camera"][2] == "moved"
    assert rows["box"][0] == pytest.approx(1000 * SHIFT_M, abs=3.0)
    assert rows["box"][1] == pytest.approx(TURN_DEG, abs=2.0)
    assert (rows["box"][2], rows["other"][2]) == ("moved", "stayed")
    assert line.startswith("camera moved ")
    assert line.endswith("1 of 2 objects stayed")


def test_photographs_of_two_cameras_and_those_without_depth_are_refused(captures, tmp_path):
    runner, place = RuleRunner(tmp_path), support(0).camera_pose
    bare = captures[1].model_copy(update={"measured": None})
    with pytest.raises(RuleError, match="the second photograph has no depth"):
        runner.run("capture.pair", first=captures[0], second=bare, first_pose=place, second_pose=place)
    other = capture(captures[1].photograph.rgb.pixels, captures[1].measured.depth.depth, factories.camera(320, 240))
    with pytest.raises(RuleError, match="different intrinsics"):
        runner.run("capture.pair", first=captures[0], second=other, first_pose=place, second_pose=place)
