"""Masks from the photograph alone, against the true masks of a reference world."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from dextera_build.artifacts.base import File
from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.objects.object import Element, Elements
from dextera_build.artifacts.objects.view import Segmentation
from dextera_build.artifacts.scenes.scene import Truth
from dextera_build.errors import RuleError
from dextera_build.geometry.regions import box_of
from dextera_build.testing import RuleRunner
from tests import factories, tabletops

RECIPE = Path(__file__).parents[4] / "recipes/reference/laptop_scene.yaml"
RED, BLUE = (0.75, 0.1, 0.1), (0.15, 0.2, 0.7)
LEAST = {"laptop": 0.94, "mug": 0.92, "carton": 0.98, "bowl": 0.97}
"""Mask IoU that each thing reaches; 0.961, 0.944, 0.996 and 0.993 were measured."""


@pytest.fixture(scope="module")
def shot(tmp_path_factory) -> tuple[Capture, Truth]:
    """The photograph of reference/laptop_scene at half its size, without the robot."""
    told = dict(yaml.safe_load(RECIPE.read_text())["nodes"]["world"])
    options = {name: value for name, value in told.items() if name not in ("rule", "robot")}
    lens = options["camera"]
    halved = {name: value / 2 for name, value in lens.items() if name.endswith("_px")}
    size = {"width_px": lens["width_px"] // 2, "height_px": lens["height_px"] // 2}
    runner = RuleRunner(tmp_path_factory.mktemp("shot"))
    world = runner.run("reference.world", options={**options, "camera": {**lens, **halved, **size}})
    return runner.run("reference.photograph", world=world, options={"seed": 7}), runner.run(
        "reference.truth", world=world
    )


def listed(**boxes: tuple[int, int, int, int]) -> Elements:
    things = (Element(name=name, category="object", phrase=name, box=box) for name, box in boxes.items())
    return Elements(elements=tuple(things), source="scene.yaml")


def cut(tmp_path: Path, capture: Capture, elements: Elements) -> Segmentation:
    found: Segmentation = RuleRunner(tmp_path).run(
        "factorize.segment", backend="grabcut", photograph=capture.photograph, elements=elements
    )
    return found


@pytest.mark.slow
def test_each_thing_of_the_reference_world_is_cut_out(tmp_path, shot):
    capture, truth = shot
    true = {name: truth.labels.labels == thing.label for name, thing in truth.objects.items()}
    boxes = {name: box_of(mask) for name, mask in true.items()}
    text = "elements:\n" + "".join(f"- {{name: {name}, box: {list(box)}}}\n" for name, box in boxes.items())
    elements = RuleRunner(tmp_path).run(
        "factorize.parse", backend="written", photograph=capture.photograph, scene=File(data=text.encode())
    )
    found = cut(tmp_path, capture, elements)
    ious = {name: tabletops.iou(found.map.labels == n, true[name]) for n, name in enumerate(found.names, start=1)}
    assert set(ious) == set(LEAST)
    assert not {name: iou for name, iou in ious.items() if iou < LEAST[name]}, ious
    assert {each.view.asset_source for each in found.items.values()} == {"rgb"}
    assert all(each.measured is None for each in found.items.values())


def test_of_two_things_the_lower_one_hides_the_other(tmp_path):
    scene = tabletops.tabletop(
        (tabletops.cylinder(0.03, 0.2, BLUE), factories.pose(0.0, -0.1)),
        (tabletops.box(0.2, 0.05, 0.1, RED), factories.pose(0.0, 0.05)),
    )
    masks = [scene.labels.labels == number for number in (1, 2)]
    found = cut(tmp_path, scene.capture, listed(can=box_of(masks[0]), box=box_of(masks[1])))
    assert found.items["box"].view.occluder.sum() > 300
    assert not found.items["can"].view.occluder.any()


def test_a_static_element_is_fixed_and_hides_what_is_behind_it(tmp_path):
    scene = tabletops.tabletop(
        (tabletops.cylinder(0.03, 0.2, BLUE), factories.pose(0.0, -0.1)),
        (tabletops.box(0.2, 0.05, 0.1, RED), factories.pose(0.0, 0.05)),
    )
    masks = [scene.labels.labels == number for number in (1, 2)]
    both = listed(arm=box_of(masks[0]), box=box_of(masks[1])).elements
    elements = Elements(elements=(both[0].model_copy(update={"interactive": False}), both[1]), source="scene.yaml")
    found = cut(tmp_path, scene.capture, elements)
    assert found.names == ("box",)
    assert tabletops.iou(found.map.fixed, masks[0]) > 0.8
    assert found.items["box"].view.occluder.any()


@pytest.mark.medium
def test_the_same_photograph_gives_the_same_bytes(tmp_path):
    scene = tabletops.tabletop((tabletops.box(0.1, 0.06, 0.14, RED), factories.pose(0.0, 0.0, yaw=0.4)))
    runner, elements = RuleRunner(tmp_path), listed(box=box_of(scene.labels.labels == 1))
    first, second = (runner.encode(cut(tmp_path, scene.capture, elements)) for _ in range(2))
    assert first == second


def test_a_box_outside_of_the_photograph_is_refused(tmp_path):
    scene = tabletops.tabletop()
    with pytest.raises(RuleError, match="the box of `box` is outside the photograph") as caught:
        cut(tmp_path, scene.capture, listed(box=(700, 0, 800, 90)))
    assert caught.value.facts == {"box": "[700, 0, 800, 90]", "photograph": "320 x 240 px"}


def test_elements_without_boxes_are_refused(tmp_path):
    with pytest.raises(RuleError, match="no element has a box to cut out") as caught:
        cut(tmp_path, tabletops.tabletop().capture, Elements(elements=(), source="scene.yaml"))
    assert "`factorize.parse`" in caught.value.hint


def test_without_a_file_nothing_is_listed(tmp_path):
    photograph = tabletops.tabletop().capture.photograph
    with pytest.raises(RuleError, match=r"proposes no elements, and no `scene\.yaml` lists them") as caught:
        RuleRunner(tmp_path).run("factorize.parse", backend="written", photograph=photograph)
    assert caught.value.hint == "give the input `scene`"
