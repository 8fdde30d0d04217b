"""Masks of rendered tabletops and real captures against their labels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.image import LabelImage
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests import factories, tabletops

CAPTURES = Path(__file__).parents[5] / "shared" / "captures"
RED, BLUE, WHITE, GREEN = (0.75, 0.1, 0.1), (0.15, 0.2, 0.7), (0.9, 0.9, 0.9), (0.1, 0.5, 0.2)


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def segmented(runner, capture, profile: str = "cpu"):
    support = runner.run("align.support", **factories.shot(capture))
    elements = runner.run("factorize.parse", profile=profile, **factories.shot(capture), support=support)
    chosen = {**factories.shot(capture), "support": support, "elements": elements}
    return runner.run("factorize.segment", profile=profile, **chosen)


@pytest.mark.slow
def test_regions_of_the_elements_are_not_found_again(runner, monkeypatch):
    scene = tabletops.tabletop((tabletops.box(0.08, 0.08, 0.1, RED), factories.pose(-0.1)))
    given = {**factories.shot(scene.capture), "support": runner.run("align.support", **factories.shot(scene.capture))}
    elements = runner.run("factorize.parse", **given)
    assert elements.regions.max() == 1
    backend = runner.find("factorize.segment").backends["depth"].module
    again = runner.run("factorize.segment", **given, elements=elements.model_copy(update={"regions": None}))
    monkeypatch.setattr(backend, "scenery", None)
    found = runner.run("factorize.segment", **given, elements=elements)
    assert np.array_equal(found.map.labels, again.map.labels)
    smaller = elements.model_copy(update={"regions": elements.regions[:-1]})
    with pytest.raises(RuleError, match="the elements are of another picture"):
        runner.run("factorize.segment", **given, elements=smaller)


def scores(segmentation, truth: np.ndarray) -> list[float]:
    """Best IoU of each true thing."""
    found = segmentation.map.labels
    return [
        max(tabletops.iou(truth == number, found == j + 1) for j in range(len(segmentation.names)))
        for number in range(1, truth.max() + 1)
    ]


@pytest.mark.medium
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_things_apart_are_cut_out_tightly(runner, noise):
    scene = tabletops.tabletop(
        (tabletops.box(0.1, 0.06, 0.14, RED), factories.pose(-0.16, 0.02, yaw=0.5)),
        (tabletops.bowl(WHITE), factories.pose(0.03, -0.1)),
        (tabletops.cylinder(0.035, 0.12, BLUE), factories.pose(0.18, 0.06)),
        noise=noise,
    )
    found = segmented(runner, scene.capture)
    assert len(found.names) == 3
    assert min(scores(found, scene.labels.labels)) > 0.9


@pytest.mark.slow
def test_a_bowl_keeps_its_floor(runner):
    scene = tabletops.tabletop((tabletops.bowl(WHITE), factories.pose(0.0, -0.05)))
    found = segmented(runner, scene.capture)
    rows, columns = np.nonzero(found.map.labels == 1)
    middle = int(np.median(rows)), int(np.median(columns))
    assert found.map.labels[middle] == 1
    assert scores(found, scene.labels.labels)[0] > 0.9


@pytest.mark.slow
def test_a_stack_is_split_at_its_creases(runner):
    scene = tabletops.tabletop(
        (tabletops.box(0.2, 0.14, 0.06, RED), factories.pose(0.0, 0.0, yaw=0.2)),
        (tabletops.box(0.1, 0.08, 0.05, WHITE), factories.pose(0.0, 0.0, 0.06, yaw=0.7)),
        (tabletops.cylinder(0.03, 0.08, GREEN), factories.pose(0.0, 0.0, 0.11)),
        noise=1.0,
        lens=tabletops.FINE,
    )
    found = segmented(runner, scene.capture)
    assert len(found.names) == 3
    assert min(scores(found, scene.labels.labels)) > 0.85


@pytest.mark.medium
def test_one_thing_behind_another_stays_one(runner):
    scene = tabletops.tabletop(
        (tabletops.cylinder(0.03, 0.2, BLUE), factories.pose(0.0, -0.1)),
        (tabletops.box(0.2, 0.05, 0.1, RED), factories.pose(0.0, 0.05)),
        noise=0.5,
    )
    found = segmented(runner, scene.capture)
    assert len(found.names) == 2
    assert min(scores(found, scene.labels.labels)) > 0.85


@pytest.mark.slow
def test_two_things_of_equal_height_behind_another_stay_two(runner):
    scene = tabletops.tabletop(
        (tabletops.cylinder(0.03, 0.2, BLUE), factories.pose(0.0, -0.1)),
        (tabletops.box(0.08, 0.05, 0.1, RED), factories.pose(-0.05, 0.05)),
        (tabletops.box(0.08, 0.09, 0.1, GREEN), factories.pose(0.05, 0.02)),
        noise=0.5,
    )
    found = segmented(runner, scene.capture)
    assert len(found.names) == 3
    assert min(scores(found, scene.labels.labels)) > 0.8


@pytest.mark.medium
def test_the_view_is_a_crop_that_knows_its_camera(runner):
    scene = tabletops.tabletop(
        (tabletops.cylinder(0.03, 0.2, BLUE), factories.pose(0.0, -0.1)),
        (tabletops.box(0.2, 0.05, 0.1, RED), factories.pose(0.0, 0.05)),
    )
    found = segmented(runner, scene.capture)
    for number, name in enumerate(found.names, start=1):
        view, measured = found.items[name].view, found.items[name].measured
        left = round(scene.capture.photograph.camera.cx - view.camera.cx)
        top = round(scene.capture.photograph.camera.cy - view.camera.cy)
        height, width = view.mask.shape
        box = (slice(top, top + height), slice(left, left + width))
        assert np.array_equal(view.mask, found.map.labels[box] == number)
        assert np.array_equal(view.rgb.pixels, scene.capture.photograph.rgb.pixels[box])
        assert np.array_equal(measured.depth.depth, scene.capture.measured.depth.depth[box])
        assert (view.camera.width, view.camera.height) == (width, height)
        assert not (view.occluder & view.mask).any()
    behind, before = (found.items[name].view for name in ("red_box", "blue_can"))
    assert behind.occluder.sum() > 300, "the cylinder hides the box"
    assert before.occluder.sum() < 30, "nothing hides the cylinder"


@pytest.mark.medium
def test_what_belongs_to_no_object_is_fixed(runner):
    arm = factories.box_mesh((-0.03, -0.02, 0.2), (0.03, 0.05, 1.2), colour=(0.3, 0.3, 0.3))
    scene = tabletops.tabletop(
        (tabletops.box(0.1, 0.06, 0.14, RED), factories.pose(-0.16, 0.02, yaw=0.5)),
        (arm, factories.pose(0.1, 0.1)),
    )
    found = segmented(runner, scene.capture)
    assert found.names == ("red_box",)
    assert found.map.fixed[scene.labels.labels == 2].mean() > 0.95
    assert not (found.map.fixed & (found.map.labels > 0)).any()


@pytest.mark.slow
def test_colour_finds_a_border_that_depth_lost(runner):
    scene = tabletops.tabletop((tabletops.box(0.1, 0.06, 0.14, RED), factories.pose(0.0, 0.0, yaw=0.4)), noise=0.3)
    truth = scene.labels.labels == 1
    rows, columns = np.nonzero(truth)
    depth = scene.capture.measured.depth.depth.copy()
    # As a camera with its projector on the right does: no depth on a strip inside and outside of the left edge.
    for row in np.unique(rows):
        edge = columns[rows == row].min()
        depth[row, edge - 6 : edge + 5] = 0.0
    capture = factories.rgbd(scene.capture.photograph.rgb.pixels, depth, scene.capture.photograph.camera)
    found = segmented(runner, capture)
    assert scores(found, scene.labels.labels)[0] > 0.93


@pytest.mark.medium
def test_the_same_capture_gives_the_same_bytes(runner):
    scene = tabletops.tabletop((tabletops.bowl(WHITE), factories.pose(0.03, -0.1)))
    first, second = (runner.encode(segmented(runner, scene.capture)) for _ in range(2))
    assert first == second


@pytest.mark.medium
def test_renaming_an_element_leaves_its_view_alone(runner):
    scene = tabletops.tabletop((tabletops.bowl(WHITE), factories.pose(0.03, -0.1)))
    support = runner.run("align.support", **factories.shot(scene.capture))
    elements = runner.run("factorize.parse", **factories.shot(scene.capture), support=support)
    renamed = elements.model_copy(
        update={"elements": tuple(e.model_copy(update={"name": f"my_{e.name}"}) for e in elements.elements)}
    )
    views = [
        next(
            iter(
                runner.run(
                    "factorize.segment", **factories.shot(scene.capture), support=support, elements=e
                ).items.values()
            )
        )
        for e in (elements, renamed)
    ]
    assert runner.encode(views[0]) == runner.encode(views[1])


@pytest.mark.medium
def test_the_stub_cuts_out_what_stands_apart(runner):
    scene = tabletops.tabletop(
        (tabletops.box(0.1, 0.06, 0.14, RED), factories.pose(-0.16, 0.02, yaw=0.5)),
        (tabletops.cylinder(0.035, 0.12, BLUE), factories.pose(0.18, 0.06)),
    )
    found = segmented(runner, scene.capture, "stub")
    assert len(found.names) == 2
    assert min(scores(found, scene.labels.labels)) > 0.7


@pytest.mark.medium
def test_boxes_far_from_everything_are_refused(runner):
    scene = tabletops.tabletop((tabletops.bowl(WHITE), factories.pose(0.03, -0.1)))
    support = runner.run("align.support", **factories.shot(scene.capture))
    elements = runner.run("factorize.parse", **factories.shot(scene.capture), support=support)
    moved = elements.model_copy(
        update={"elements": tuple(e.model_copy(update={"box": (0, 0, 9, 9)}) for e in elements.elements)}
    )
    with pytest.raises(RuleError, match="no element could be segmented") as caught:
        runner.run("factorize.segment", **factories.shot(scene.capture), support=support, elements=moved)
    assert "white_bowl" in caught.value.facts["elements"]


def real(runner, name: str):
    if not (CAPTURES / name).is_dir():
        pytest.skip(f"{name} is not here")
    return Folder(files={path.name: path.read_bytes() for path in (CAPTURES / name).iterdir()})


@pytest.mark.medium
@pytest.mark.parametrize(
    ("name", "box"),
    [
        ("table_mustard", (352, 88, 479, 341)),
        pytest.param("table_blue_mug", (270, 164, 424, 328), marks=pytest.mark.slow),
        pytest.param("table_white_bowl", (284, 226, 460, 342), marks=pytest.mark.slow),
        pytest.param("table_cheezit", (346, 48, 505, 330), marks=pytest.mark.slow),
        pytest.param("table_sugar", (346, 88, 460, 334), marks=pytest.mark.slow),
    ],
)
def test_the_object_on_the_real_table_is_found_once_and_whole(runner, name, box):
    found = segmented(runner, runner.run("capture.folder", folder=real(runner, name)))
    assert len(found.names) == 1
    rows, columns = np.nonzero(found.map.labels)
    seen = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
    # The boxes were drawn by hand around the objects in the photographs.
    assert np.abs(seen - box).max() <= 10


@pytest.mark.slow
@pytest.mark.parametrize("number", ["00", "05", "13", "18", "22", "27", "31", "36", "40"])
def test_real_clutter_is_split(runner, number):
    folder = real(runner, f"clutter_learn_{number}")
    found = segmented(runner, runner.run("capture.folder", folder=folder))
    options = {"type": "LabelImage", "path": "instances.png"}
    truth = runner.run("capture.file", options=options, file=folder)
    table = runner.run("benchmark.instances", segmentation=found, truth=truth)
    told = [row[5] for row in table.rows]
    # One thing of the last photograph is found with a piece beside it.
    assert told.count("spurious") <= (number == "40")
    assert set(told) <= {"found", "spurious"}
    assert np.mean([row[4] for row in table.rows if row[5] == "found"]) > 0.85


@pytest.mark.medium
def test_the_robot_is_no_object_but_hides_one(runner):
    scene = tabletops.tabletop(
        (tabletops.box(0.2, 0.05, 0.1, RED), factories.pose(0.0, 0.05)),
        (tabletops.cylinder(0.02, 0.15, BLUE), factories.pose(0.02, -0.1)),
        noise=0.5,
    )
    shot = factories.shot(scene.capture)
    robot = LabelImage(labels=(scene.labels.labels == 2).astype(np.int32))
    support = runner.run("align.support", **shot)
    elements = runner.run("factorize.parse", profile="cpu", **shot, support=support, robot=robot)
    assert sum(element.interactive for element in elements.elements) == 1
    found = runner.run("factorize.segment", profile="cpu", **shot, support=support, elements=elements, robot=robot)
    assert not (found.map.labels[robot.labels > 0] > 0).any()
    assert scores(found, (scene.labels.labels == 1).astype(int))[0] > 0.9
    (instance,) = found.items.values()
    left, top = (
        scene.capture.photograph.camera.cx - instance.view.camera.cx,
        scene.capture.photograph.camera.cy - instance.view.camera.cy,
    )
    height, width = instance.view.mask.shape
    crop = robot.labels[round(top) : round(top) + height, round(left) : round(left) + width] > 0
    assert (instance.view.occluder & crop).sum() > 0.5 * crop.sum()


def test_pixels_of_a_robot_in_another_picture_are_refused(runner):
    scene = tabletops.tabletop((tabletops.cylinder(0.03, 0.2, BLUE), factories.pose(0.0, 0.0)))
    elsewhere = LabelImage(labels=np.zeros((3, 4), np.int32))
    with pytest.raises(RuleError, match="the robot's pixels are of another picture"):
        runner.run("factorize.parse", profile="cpu", **factories.shot(scene.capture), robot=elsewhere)
