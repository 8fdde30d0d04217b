"""Corrections of split and joined objects in a `scene.yaml`, found again with the backends of profile cpu."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.cameras.image import png
from dextera_build.building.corrections import Corrected, Corrections, words
from dextera_build.building.photographed import Photographed
from dextera_build.errors import RuleError, UsageError
from dextera_build.geometry import pictures
from dextera_build.project import project as projects
from dextera_build.project.planning import Added
from dextera_build.session import Session
from tests import factories, tabletops

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("twin_workers")]

RED, GREEN, BLUE = (0.8, 0.2, 0.2), (0.1, 0.5, 0.2), (0.2, 0.2, 0.8)
BOX = (0.08, 0.08, 0.10)


class Desk:
    """A project in the current folder with a photograph of two boxes side by side, and a blue one."""

    def __init__(self, root: Path, colour: tuple[float, float, float] = RED) -> None:
        self.scene = tabletops.tabletop(
            (tabletops.box(*BOX, RED), factories.pose(-0.12)),
            (tabletops.box(*BOX, colour), factories.pose(-0.04)),
            (tabletops.box(*BOX, BLUE), factories.pose(0.12)),
        )
        tabletops.write(self.scene.capture, root / "shot")
        (root / "dxb.toml").write_text('cache = "cache"\n')
        self.project = projects.find()

    def session(self, added: Added | None = None) -> Session:
        return Session(self.project, "twin/tabletop", added or Added({"capture": "shot"}), makes=True)

    def corrections(self, added: Added | None = None, photograph: Photograph | None = None) -> Corrections:
        shown = photograph or self.scene.capture.photograph
        return Corrections(self.session(added), pictures.digest_of(shown.rgb.pixels))

    def pixels(self, *numbers: int) -> list[tuple[int, int]]:
        return [pictures.innermost(self.scene.labels.labels == number) for number in numbers]

    def scores(self, made: Corrected, **things: Sequence[int]) -> list[float]:
        """IoU of each object with the boxes of the scene that it is."""
        found = Photographed(self.session(made.added)).find(lambda event: None)
        assert found is not None
        names, labels = found.objects.names, found.objects.map.labels
        return [
            tabletops.iou(labels == names.index(name) + 1, np.isin(self.scene.labels.labels, numbers))
            for name, numbers in things.items()
        ]


@pytest.fixture
def desk(tmp_path, monkeypatch) -> Desk:
    monkeypatch.chdir(tmp_path)
    return Desk(tmp_path)


def test_an_object_is_split_and_merged_again(desk):
    first, second = desk.pixels(1, 2)
    made = desk.corrections().split("red_box", (first, second))
    assert (made.file, made.objects) == ("scene.yaml", ("red_box", "red_box_2", "blue_box"))
    text = Path("scene.yaml").read_text()
    for line, point in zip(made.lines, (first, second), strict=True):
        number = int(line.removeprefix("line ").partition(",")[0])
        assert text.splitlines()[number - 1].strip() == f"at_px: {list(point)}"
    assert min(desk.scores(made, red_box=[1], red_box_2=[2], blue_box=[3])) > 0.9
    assert words(desk.session(made.added), made.added)[1:] == [
        *("twin/tabletop", "--input", "capture=shot", "--input", "description=scene.yaml")
    ]
    again = desk.corrections(made.added).merge("red_box_2", "red_box")
    assert again.objects == ("red_box_2", "blue_box")
    assert again.lines[-1] == "`red_box` is removed"
    assert min(desk.scores(again, red_box_2=[1, 2], blue_box=[3])) > 0.9


def test_what_cannot_be_corrected_is_refused_and_no_file_changes(desk):
    first, other = desk.pixels(1, 3)
    with pytest.raises(UsageError) as caught:
        desk.corrections().split("red_box", (first, other))
    assert (caught.value.code, caught.value.message) == ("DXB-U223", f"the point {list(other)} is not on `red_box`")
    with pytest.raises(UsageError, match="no object is called `mug`"):
        desk.corrections().merge("red_box", "mug")
    another = tabletops.tabletop().capture.photograph
    with pytest.raises(UsageError, match="has another photograph than the view"):
        desk.corrections(photograph=another).merge("red_box", "blue_box")
    with pytest.raises(UsageError, match="both points on `red_box` are the same"):
        desk.corrections().split("red_box", (first, first))
    painted = np.where(desk.scene.labels.labels == 3, np.uint8(255), np.uint8(0))
    Path("masks").mkdir()
    Path("masks/blue_box.png").write_bytes(png(painted))
    with pytest.raises(RuleError, match=r"`blue_box\.png` is the mask of no object"):
        desk.corrections(Added({"capture": "shot", "masks": "masks"})).merge("red_box", "blue_box")
    assert not Path("scene.yaml").exists()
    Path("scene.yaml").write_text("elements: [{name: mine}]\n")
    with pytest.raises(UsageError, match=r"`scene\.yaml` exists already"):
        desk.corrections().merge("red_box", "blue_box")
    assert Path("scene.yaml").read_text() == "elements: [{name: mine}]\n"


def test_without_depth_the_boxes_are_corrected(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    desk = Desk(tmp_path, GREEN)
    red = np.isin(desk.scene.labels.labels, (1, 2))
    blue = desk.scene.labels.labels == 3
    rows = [f"- {{name: {name}, box: {box(mask)}}}" for name, mask in (("red", red), ("blue", blue))]
    Path("scene.yaml").write_text("elements:\n" + "\n".join(rows) + "\n")
    backends = {"factorize.parse": "written", "factorize.segment": "grabcut"}
    added = Added({"capture": "shot", "description": "scene.yaml"}, backends=backends)
    made = desk.corrections(added).split("red", desk.pixels(1, 2))
    assert made.objects == ("red", "red_2", "blue")
    assert min(desk.scores(made, red=[1], red_2=[2])) > 0.7
    again = desk.corrections(made.added).merge("red", "red_2")
    assert again.objects == ("red", "blue")
    assert desk.scores(again, red=[1, 2]) > [0.8]


def box(mask: np.ndarray) -> list[int]:
    """Left, top, right, bottom [px] of a mask (H, W) bool."""
    rows, columns = np.nonzero(mask)
    return [int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1]


def test_a_recipe_that_lists_its_objects_is_not_corrected(desk):
    session = Session(desk.project, "twin/box_table", makes=True)
    with pytest.raises(UsageError, match="`twin/box_table` lists its objects itself") as caught:
        Corrections(session, "").merge("box", "blue_cube")
    assert caught.value.code == "DXB-U224"
