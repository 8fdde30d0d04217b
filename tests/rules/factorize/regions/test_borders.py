"""What the picture's border cuts: an object if most of it is in view, else a part of the room that a warning names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.cameras.camera import Capture, Photograph
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.object import Element, Elements
from dextera_build.artifacts.objects.view import Segmentation, Traits
from dextera_build.rule import Context
from dextera_build.testing import RuleRunner
from rules.factorize.masks.cutting import Cutter, Said
from rules.factorize.measured import Measurements
from rules.factorize.regions import borders
from tests import factories, tabletops

RED, BLUE = (0.75, 0.1, 0.1), (0.15, 0.2, 0.7)
INSIDE = (tabletops.box(0.1, 0.06, 0.14, RED), factories.pose(-0.1, 0.05, yaw=0.5))
CAN_M = 0.04
"""Radius of the can."""


def parsed(folder: Path, capture: Capture) -> tuple[list[Element], list[str]]:
    """Elements but for the support, and warnings."""
    runner = RuleRunner(folder)
    support = runner.run("align.support", **factories.shot(capture))
    found = runner.run("factorize.parse", **factories.shot(capture), support=support)
    return [element for element in found.elements if element.category != "support"], runner.outcome.warnings


def seen(folder: Path, capture: Capture) -> tuple[RuleRunner, Elements, Segmentation]:
    """Elements and masks, and the runner of the latter."""
    runner, shot = RuleRunner(folder), factories.shot(capture)
    support = runner.run("align.support", **shot)
    elements = runner.run("factorize.parse", **shot, support=support)
    return runner, elements, runner.run("factorize.segment", **shot, support=support, elements=elements)


def with_can(share_m: float) -> Capture:
    """A can whose axis is `share_m` inside the right border of the picture [m], and a box that is whole."""
    can = tabletops.cylinder(CAN_M, 0.12, BLUE)
    scene = tabletops.tabletop(INSIDE, (can, factories.pose(0.454 - share_m, 0.0)), half=0.9, lens=tabletops.FINE)
    return scene.capture


def lower_part_cut(capture: Capture, rows: int) -> Capture:
    """The picture's upper `rows`."""
    photo, measured = capture.photograph, capture.measured
    assert measured is not None
    lens = photo.camera.crop(0, 0, photo.camera.width, rows)
    return factories.rgbd(photo.rgb.pixels[:rows].copy(), measured.depth.depth[:rows].copy(), lens)


@pytest.mark.slow
def test_a_can_that_the_border_cuts_beyond_its_axis_is_an_object(tmp_path):
    capture = with_can(0.5 * CAN_M)
    runner, found, segmented = seen(tmp_path, capture)
    assert [element.cut for element in found.elements if element.interactive] in ([False, True], [True, False])
    (name,) = (name for name, one in segmented.items.items() if one.traits.cut)
    assert runner.outcome.warnings == [
        f"the right border of the picture cuts {name}: what is outside the picture is completed by symmetry"
    ]


@pytest.mark.slow
def test_an_object_whose_mask_grows_to_the_border_is_cut(tmp_path):
    """Depth ends before the picture does, so parsing sees a whole can; its colour goes on to the border."""
    capture = with_can(0.5 * CAN_M)
    assert capture.measured is not None
    depth = capture.measured.depth.depth.copy()
    depth[:, -5:] = 0.0
    runner, elements, segmented = seen(
        tmp_path, factories.rgbd(capture.photograph.rgb.pixels, depth, capture.photograph.camera)
    )
    assert not any(element.cut for element in elements.elements)
    (name,) = (name for name in segmented.names if borders.touched(segmented.mask(name)))
    assert [name] == [name for name, one in segmented.items.items() if one.traits.cut]
    assert any(f"the right border of the picture cuts {name}:" in text for text in runner.outcome.warnings)


@pytest.mark.slow
def test_a_can_of_which_little_is_in_view_stays_in_the_room_and_is_named(tmp_path):
    found, warnings = parsed(tmp_path, with_can(-0.5 * CAN_M))
    assert [element.cut for element in found if element.interactive] == [False]
    (static,) = [element for element in found if not element.interactive]
    assert static.cut
    (warning,) = warnings
    assert warning.startswith("the right border of the picture cuts the blue ")
    assert f"in the box {list(static.box or ())}" in warning


@pytest.mark.slow
def test_how_far_a_box_continues_is_not_guessed(tmp_path):
    box = tabletops.box(0.12, 0.1, 0.12, BLUE)
    scene = tabletops.tabletop(INSIDE, (box, factories.pose(0.44, 0.0)), half=0.9, lens=tabletops.FINE)
    found, (warning,) = parsed(tmp_path, scene.capture)
    assert [element.cut for element in found if element.interactive] == [False]
    assert "too little of it is in view to make a body" in warning


@pytest.mark.medium
@pytest.mark.parametrize(("share", "movable"), [(0.75, True), (0.35, False)])
def test_a_foot_below_the_picture_is_on_the_support_beside_it(tmp_path, share, movable):
    scene = tabletops.tabletop(
        (tabletops.box(0.1, 0.1, 0.15, BLUE), factories.pose(0.05, -0.1, yaw=0.3)), half=0.9, lens=tabletops.FINE
    )
    rows = np.flatnonzero(scene.labels.labels.any(axis=1))
    cut = lower_part_cut(scene.capture, int(rows[0] + share * len(rows)))
    runner = RuleRunner(tmp_path)
    support = runner.run("align.support", **factories.shot(cut))
    if not movable:
        with pytest.raises(Exception, match="the border of the picture cuts the thing"):
            runner.run("factorize.parse", **factories.shot(cut), support=support)
        return
    found = runner.run("factorize.parse", **factories.shot(cut), support=support)
    assert [(element.interactive, element.cut) for element in found.elements][:1] == [(True, True)]
    segmented = runner.run("factorize.segment", **factories.shot(cut), support=support, elements=found)
    assert tabletops.iou(segmented.map.labels == 1, scene.labels.labels[: cut.photograph.camera.height] == 1) > 0.9


def test_nothing_but_a_border_is_touched():
    mask = np.zeros((40, 60), bool)
    mask[10:20, 10:20] = True
    assert borders.touched(mask) == ()
    assert borders.touched(np.pad(mask, ((0, 0), (0, 0)))[:20]) == (borders.BOTTOM,)
    assert borders.touched(mask[:, 10:]) == (borders.LEFT,)
    assert borders.touched(mask[10:, :20]) == (borders.TOP, borders.RIGHT)


def test_masks_decide_which_objects_are_cut(tmp_path):
    """What parsing had said of them does not count."""
    labels = np.zeros((40, 60), np.int32)
    labels[10:30, 5:20], labels[10:30, 50:] = 1, 2
    photograph = Photograph(rgb=Image(pixels=np.zeros((40, 60, 3), np.uint8)), camera=factories.camera(60, 40))
    traits = Traits(category="object", body_type="rigid", material="plastic", cut=True)
    said = {
        "inside": Said("thing", traits, "rgb"),
        "grown": Said("thing", traits.model_copy(update={"cut": False}), "rgb"),
    }
    cutter = Cutter(photograph, None, None, Measurements(Context(scratch=tmp_path), None, "no depth"))
    found = cutter.cut_out(labels, said, [], 4)
    assert {name: one.traits.cut for name, one in found.items.items()} == {"inside": False, "grown": True}


@pytest.mark.slow
def test_a_cut_can_is_completed_by_symmetry(tmp_path):
    capture = with_can(0.5 * CAN_M)
    runner, _, segmented = seen(tmp_path, capture)
    support = runner.run("align.support", **factories.shot(capture))
    (one,) = [item for item in segmented.items.values() if item.traits.cut]
    shape = runner.run("factorize.mesh", view=one.view, measured=one.measured, support=support)
    assert shape.mesh.extent == pytest.approx((2 * CAN_M, 2 * CAN_M, 0.12), abs=0.004)
