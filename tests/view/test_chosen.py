"""The panel about the object that was clicked: names, merging, splitting by two pixels, and what it says of errors."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dextera_build.errors import UsageError
from dextera_build.geometry import transforms
from dextera_build.view import scene
from tests import factories
from tests.view.test_view import Recorder


class Asked:
    """Keeps what the panel asks for."""

    names = ("box", "lap", "tin")

    def __init__(self) -> None:
        self.calls: list[tuple[object, ...]] = []
        self.refused: Exception | None = None

    def mask(self, name: str) -> np.ndarray:
        lens = factories.camera()
        mask = np.zeros((lens.height, lens.width), bool)
        mask[10:20, 30:50] = True
        return mask

    def _asked(self, *call: object) -> str:
        self.calls.append(call)
        if self.refused is not None:
            raise self.refused
        return "done"

    def bind(self, label: str, name: str) -> str:
        return self._asked("bind", label, name)

    def merge(self, label: str, other: str) -> str:
        return self._asked("merge", label, other)

    def split(self, label: str, points: Any) -> str:
        return self._asked("split", label, points)

    def rebuild(self, say: Any) -> str:
        say("`mesh` runs")
        return self._asked("rebuild")


def press(viewer: Recorder, title: str) -> None:
    """Click a button of the panel."""
    client = SimpleNamespace(camera=SimpleNamespace(aspect=1.0), atomic=viewer.atomic)
    viewer.controls[title].clicked(SimpleNamespace(client=client))


class Shown:
    """A twin in a viewer that is not there."""

    def __init__(self) -> None:
        self.viewer, self.asked = Recorder(), Asked()
        table, lens = factories.support(), factories.camera()
        assets = {"box": factories.box_asset(), "lap": factories.laptop_asset(factories.pose(0.2))}
        scene.show_scene(
            self.viewer,
            assets,
            factories.background(),
            table,
            lens,
            photo=factories.capture(lens, table).photograph.rgb,
            mending=self.asked,
        )

    @property
    def words(self) -> str:
        return str(self.viewer.nodes["Click an object for its mass, material and friction."].content)

    def click(self, label: str, link: str = "base") -> None:
        self.viewer.nodes[f"/{label}/{link}/visual"].clicked(None)

    def press(self, title: str) -> None:
        press(self.viewer, title)

    def visible(self) -> set[str]:
        titles = ("Name", "Bind", "Merge with", "Merge", "Split", "Rebuild")
        return {title for title in titles if self.viewer.controls[title].visible}


@pytest.fixture
def shown() -> Shown:
    return Shown()


def ray(column: float, row: float) -> SimpleNamespace:
    """A click on a pixel of the photograph, seen from beside the camera."""
    lens, pose = factories.camera(), factories.support().camera_pose.matrix
    met = 0.05 * np.array([(column - lens.cx) / lens.fx, (row - lens.cy) / lens.fy, 1.0])
    eye = np.array([0.02, -0.01, -0.1])
    return SimpleNamespace(
        ray_origin=tuple(transforms.apply(pose, eye[None])[0]), ray_direction=tuple(pose[:3, :3] @ (met - eye))
    )


def test_a_clicked_object_tells_its_facts_and_takes_a_name(shown: Shown) -> None:
    assert shown.visible() == set()
    shown.click("box")
    assert shown.words.startswith("**box**\n\n* mass: ")
    name = shown.viewer.controls["Name"]
    assert name.value == "box"
    name.value = "tin"
    shown.press("Bind")
    assert (shown.asked.calls, shown.words) == ([("bind", "box", "tin")], "done")
    assert "Rebuild" not in shown.visible()


def test_two_clicked_objects_become_one(shown: Shown) -> None:
    shown.click("box")
    shown.click("lap")
    other = shown.viewer.controls["Merge with"]
    assert (other.options, other.value) == (("box", "tin"), "box")
    shown.press("Merge")
    assert (shown.asked.calls, shown.words) == ([("merge", "lap", "box")], "done")
    shown.press("Rebuild")
    assert shown.asked.calls[-1] == ("rebuild",)


def test_an_object_is_split_by_two_pixels_of_the_photograph(shown: Shown) -> None:
    picture = shown.viewer.nodes["/photograph"]
    shown.click("box")
    shown.press("Split")
    assert picture.visible
    assert (picture.image[15, 40] > picture.image[15, 60]).all()  # everything but the object is dark
    assert "**box**" in shown.words
    picture.clicked(ray(33.0, 12.0))
    assert picture.image[12, 33].tolist() == [255, 120, 0]
    assert shown.asked.calls == []
    picture.clicked(ray(45.0, 17.0))
    assert shown.asked.calls == [("split", "box", [(33, 12), (45, 17)])]
    assert (picture.visible, picture.clicked) == (False, None)
    assert "Rebuild" in shown.visible()


def test_an_error_is_one_message_and_nothing_is_offered_to_build(shown: Shown) -> None:
    shown.asked.refused = UsageError("`box` is gone", code="DXB-U216", facts={"objects": "tin"}, hint="build again")
    shown.click("box")
    shown.press("Merge")
    assert shown.words == "**DXB-U216** `box` is gone\n\n* objects: tin\n\nbuild again"
    assert "Rebuild" not in shown.visible()
    shown.asked.refused = ZeroDivisionError()
    with pytest.raises(ZeroDivisionError):
        shown.press("Merge")
    assert shown.words == "This failed unexpectedly, and the terminal says more: ZeroDivisionError"
    shown.asked.refused = None
    shown.press("Merge")
    assert shown.words == "done"
