"""A camera held in any way gives the same twin as one held upright."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import File, Folder
from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.geometry import pictures, upright
from dextera_build.testing import RuleRunner
from tests import factories, object_views, tabletops

CAPTURES = Path(__file__).parents[4] / "shared" / "captures"
SIDES = ("top", "right", "bottom", "left")
THINGS = (
    (tabletops.box(0.1, 0.08, 0.15, (0.8, 0.2, 0.2)), factories.pose(-0.15, 0.05, yaw=0.4)),
    (tabletops.bowl(), factories.pose(0.12, -0.05)),
    (tabletops.cylinder(0.035, 0.12, (0.2, 0.5, 0.8)), factories.pose(0.05, 0.15)),
)


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def turned(capture: Capture, count: int) -> Capture:
    """The capture of a camera that was turned, so that `count` quarter turns make its picture upright."""
    assert capture.measured is not None
    seen = capture.photograph
    pixels, depth = (upright.turned(x, -count) for x in (seen.rgb.pixels, capture.measured.depth.depth))
    return Capture(
        photograph=type(seen)(rgb=Image(pixels=pixels), camera=seen.camera.turned(-count)),
        measured=type(capture.measured)(depth=DepthImage(depth=depth)),
    )


def segmented(runner, capture: Capture, **options):
    shot = factories.shot(capture)
    support = runner.run("align.support", options=options, **shot)
    warnings = runner.outcome.warnings
    elements = runner.run("factorize.parse", **shot, support=support)
    return runner.run("factorize.segment", **shot, support=support, elements=elements), support, warnings


@pytest.fixture(scope="module")
def photographed() -> Capture:
    return tabletops.tabletop(*THINGS, lens=tabletops.FINE).capture


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_turned_camera_finds_the_same_things_in_the_same_world(runner, photographed, count):
    first, level, quiet = segmented(runner, photographed)
    found, support, warnings = segmented(runner, turned(photographed, count))
    assert not quiet
    assert f"{SIDES[count]} of the picture" in warnings[0]
    assert found.names == first.names
    labels = upright.turned(found.map.labels, count)
    for number in range(1, len(first.names) + 1):
        assert tabletops.iou(labels == number, first.map.labels == number) > 0.99
    moved = support.camera_pose.matrix @ np.linalg.inv(upright.turned_from_camera(count))
    assert np.abs(moved - level.camera_pose.matrix).max() < 1e-6, "the world does not turn with the camera"


@pytest.mark.slow
def test_clicks_count_in_the_picture_as_it_was_taken(runner, photographed):
    first, _, _ = segmented(runner, photographed)
    capture = turned(photographed, 1)
    labels = upright.turned(first.map.labels, -1)
    points = {name: pictures.innermost(labels == number) for number, name in enumerate(first.names, start=1)}
    lines = "\n".join(f"- {{name: my_{name}, at_px: [{x}, {y}]}}" for name, (x, y) in points.items())
    shot = factories.shot(capture)
    support = runner.run("align.support", **shot)
    scene = File(data=f"elements:\n{lines}".encode())
    elements = runner.run("factorize.parse", **shot, support=support, scene=scene)
    found = runner.run("factorize.segment", **shot, support=support, elements=elements)
    assert found.names == tuple(f"my_{name}" for name in first.names)
    for number in range(1, len(first.names) + 1):
        assert tabletops.iou(found.map.labels == number, labels == number) > 0.99


@pytest.mark.slow
def test_which_side_is_up_can_be_said(runner, photographed):
    found, _, warnings = segmented(runner, turned(photographed, 2), up="bottom")
    assert len(found.names) == 3
    assert not warnings, "nothing was assumed"


@pytest.mark.medium
@pytest.mark.parametrize("roll_deg", [135, *(pytest.param(angle, marks=pytest.mark.slow) for angle in (-44, 30, 60))])
def test_any_roll_will_do(runner, roll_deg):
    angle, turn = np.radians(roll_deg), np.eye(4)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    scene = tabletops.tabletop(*THINGS, eye=tabletops.EYE @ turn, lens=tabletops.FINE)
    found, support, _ = segmented(runner, scene.capture)
    assert (support.camera_pose.matrix[2, :3] @ scene.world_from_camera[2, :3]) > np.cos(np.radians(0.3))
    for number in range(1, 4):
        best = max(tabletops.iou(scene.labels.labels == number, found.map.labels == n) for n in range(1, 4))
        assert best > 0.95


@pytest.mark.slow
def test_from_straight_above_things_stand(runner):
    eye = factories.look_at((0.02, -0.15, 0.8), (0.0, 0.0, 0.02))
    scene = tabletops.tabletop(*THINGS, eye=eye, lens=tabletops.FINE)
    found, _, _ = segmented(runner, scene.capture)
    for number in range(1, 4):
        best = max(tabletops.iou(scene.labels.labels == number, found.map.labels == n) for n in range(1, 4))
        assert best > 0.95


def test_without_depth_the_assumed_support_turns_with_the_picture(runner, photographed):
    photograph = turned(photographed, 1).photograph
    support = runner.run("align.support", photograph=photograph, options={"up": "right"})
    assert upright.turns(support.camera_pose.matrix) == 1
    level = runner.run("align.support", photograph=photographed.photograph)
    moved = support.camera_pose.matrix @ np.linalg.inv(upright.turned_from_camera(1))
    assert np.abs(moved - level.camera_pose.matrix).max() < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("name", ["table_blue_mug", "table_mustard", "clutter_learn_13"])
def test_real_objects_keep_their_size(runner, name):
    if not (CAPTURES / name).is_dir():
        pytest.skip(f"needs shared/captures/{name}")
    capture = runner.run(
        "capture.folder", folder=Folder(files={path.name: path.read_bytes() for path in (CAPTURES / name).iterdir()})
    )
    first, _, _ = segmented(runner, capture)
    sizes = meshed(runner, first)
    found, _, _ = segmented(runner, turned(capture, 1))
    labels = upright.turned(found.map.labels, 1)
    assert found.names == first.names
    for number in range(1, len(first.names) + 1):
        assert tabletops.iou(labels == number, first.map.labels == number) > 0.99
    for name_, size in meshed(runner, found).items():
        assert np.abs(size - sizes[name_]).max() < 0.001


def meshed(runner, found) -> dict[str, np.ndarray]:
    return {
        name: np.array(runner.run("factorize.mesh", **object_views.sights(seen)).mesh.extent)
        for name, seen in found.items.items()
    }
