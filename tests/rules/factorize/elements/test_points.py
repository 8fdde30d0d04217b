"""Points of `scene.yaml` join regions of one thing, and divide a region of several, with profile cpu."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.base import File
from dextera_build.artifacts.objects.object import Element, Elements
from dextera_build.code.loader import Library
from dextera_build.errors import RuleError
from dextera_build.geometry import pictures
from dextera_build.testing import RuleRunner
from tests import factories, tabletops

Library().find("factorize.parse")
points = importlib.import_module("rules.factorize.elements.points")
scene_file = importlib.import_module("rules.factorize.elements.scene_file")
RED, BLUE = (0.75, 0.1, 0.1), (0.15, 0.2, 0.7)


class Table:
    """Boxes of these colours in a row, each against the next, and the rules that find objects."""

    def __init__(self, runner: RuleRunner, *colours: tuple[float, float, float]) -> None:
        self.count = len(colours)
        places = [0.08 * (number - (self.count - 1) / 2) for number in range(self.count)]
        boxes = [tabletops.box(0.08, 0.08, 0.1, colour) for colour in colours]
        self.scene = tabletops.tabletop(*zip(boxes, map(factories.pose, places), strict=True))
        self.runner = runner
        self.shot = factories.shot(self.scene.capture)
        self.support = runner.run("align.support", **self.shot)

    def points(self) -> list[list[int]]:
        """A pixel of each box."""
        labels = self.scene.labels.labels
        return [list(pictures.innermost(labels == number)) for number in range(1, self.count + 1)]

    def parse(self, text: str = "") -> Any:
        given = {"scene": File(data=text.encode())} if text else {}
        return self.runner.run("factorize.parse", **self.shot, **given, support=self.support)

    def segment(self, elements: Any) -> Any:
        return self.runner.run("factorize.segment", **self.shot, support=self.support, elements=elements)

    def score(self, objects: Any, name: str, *numbers: int) -> float:
        """IoU of an object with boxes of the scene."""
        mask = objects.map.labels == objects.names.index(name) + 1
        return tabletops.iou(mask, np.isin(self.scene.labels.labels, numbers))


@pytest.fixture
def runner(tmp_path) -> RuleRunner:
    return RuleRunner(tmp_path)


@pytest.mark.medium
def test_two_elements_in_one_region_divide_it(runner):
    table = Table(runner, RED, RED)
    assert table.segment(table.parse()).names == ("red_box",)  # nothing shows where one ends
    left, right = table.points()
    text = f"elements:\n- {{name: left, at_px: {left}}}\n- {{name: right, at_px: {right}}}"
    elements = table.parse(text)
    assert elements.regions.max() == 2
    objects = table.segment(elements)
    assert objects.names == ("left", "right")
    assert min(table.score(objects, "left", 1), table.score(objects, "right", 2)) > 0.95


@pytest.mark.medium
def test_the_points_of_one_element_join_its_regions(runner):
    table = Table(runner, RED, BLUE)
    assert len(table.segment(table.parse()).names) == 2
    elements = table.parse(f"elements:\n- {{name: both, at_px: {table.points()}}}")
    assert elements.regions.max() == 1
    assert [element.name for element in elements.elements if element.interactive] == ["both"]
    objects = table.segment(elements)
    assert objects.names == ("both",)
    assert table.score(objects, "both", 1, 2) > 0.95


def test_an_element_joins_a_region_with_a_part_of_another():
    regions = np.zeros((20, 90), np.int32)
    regions[5:15, 5:55], regions[5:15, 60:80] = 1, 2
    found = (Element(name="large", category="box", box=(5, 5, 55, 15), phrase="box"),)
    found += (Element(name="small", category="mug", box=(60, 5, 80, 15), phrase="mug"),)

    def divide(region: np.ndarray, own: list[list[tuple[int, int]]]) -> np.ndarray:
        columns = np.array([points[0][0] for points in own])[:, None, None]
        return np.where(region, 1 + np.abs(np.arange(90) - columns).argmin(axis=0), 0)

    wanted = scene_file.read(b"elements:\n- {name: b, at_px: [10, 9]}\n- {name: a, at_px: [[70, 9], [49, 9]]}")
    proposed = Elements(elements=found, source="proposed", regions=regions)
    made = points.settled(wanted, proposed, divide)
    assert {(each.category, each.box) for each in made.elements} == {("box", (30, 5, 80, 15)), ("box", (5, 5, 30, 15))}
    assert (made.regions[9, [10, 29, 30, 70]] == [2, 2, 1, 1]).all()  # numbered from the largest
    bare = points.settled(wanted, proposed.model_copy(update={"regions": None}), divide)
    assert [each.box for each in bare.elements] == [(5, 5, 80, 15)]


@pytest.mark.medium
def test_a_point_that_counts_for_nothing_is_refused(runner):
    table = Table(runner, RED, RED)
    left, _ = table.points()
    with pytest.raises(RuleError, match=r"the point \[1, 1\] of `a` counts for nothing: nothing that stands out"):
        table.parse(f"elements:\n- {{name: a, at_px: [{left}, [1, 1]]}}")
    with pytest.raises(RuleError, match="of `b` counts for nothing: its part of the region is empty") as caught:
        table.parse(f"elements:\n- {{name: a, at_px: {left}}}\n- {{name: b, at_px: {left}}}")
    assert (caught.value.code, caught.value.where.line) == ("DXB-B204", 3)
