"""The proposed `scene.yaml`: factorize.parse can read it for any result of parsing."""

from __future__ import annotations

import importlib

import pytest

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.object import Element, Elements
from dextera_build.building import scene_file
from dextera_build.building.photographed import Found
from dextera_build.code.loader import Library
from tests import factories
from tests.rules.factorize.elements.test_name import PHOTOGRAPH, PROPOSED

Library().find("factorize.parse")
reader = importlib.import_module("rules.factorize.elements.scene_file")

BOX = (20, 60, 80, 140)


def proposal(*elements: Element, source: str = "rgbd", **built: list[str]) -> str:
    found = Found(
        Photograph(rgb=Image(pixels=PHOTOGRAPH), camera=factories.camera()),
        Elements(elements=elements, source="proposed", asset_source=source),
        PROPOSED,
        PROPOSED.names,
    )
    return scene_file.text(found, "twin/tabletop", "dxb build twin/tabletop", built)


def element(name: str, **more: object) -> Element:
    return Element(**{"name": name, "category": "mug", "phrase": name.replace("_", " "), "box": BOX, **more})


@pytest.mark.parametrize("phrase", ["true", "it's: a #mug", "- x", "[a]", "Tasse für Öl", "7up", 'say "mug"'])
def test_any_phrase_is_read_as_it_was(phrase):
    name = PROPOSED.names[0]
    view = PROPOSED.items[name].view.model_copy(update={"phrase": phrase})
    items = {**PROPOSED.items, name: PROPOSED.items[name].model_copy(update={"view": view})}
    found = Found(
        Photograph(rgb=Image(pixels=PHOTOGRAPH), camera=factories.camera()),
        Elements(elements=(element(name),), source="proposed", asset_source="rgbd"),
        PROPOSED.model_copy(update={"items": items}),
        PROPOSED.names,
    )
    (read,) = reader.read(scene_file.text(found, "twin/tabletop", "dxb build", {}).encode())
    assert read.fields["phrase"] == phrase


def test_an_object_is_told_by_a_pixel_of_its_mask():
    (read,) = reader.read(proposal(element("red_mug")).encode())
    column, row = read.fields["at_px"]
    assert PROPOSED.map.labels[row, column] == PROPOSED.names.index("red_mug") + 1
    assert "box" not in read.fields


def test_without_depth_the_box_is_told_too():
    (read,) = reader.read(proposal(element("red_mug"), source="rgb").encode())
    assert read.fields["box"] == BOX


def test_a_material_is_assumed_unless_somebody_stated_it():
    assumed, stated = (element("red_mug", material="ceramic", material_confidence=sure) for sure in (0.7, 1.0))
    text = proposal(assumed)
    assert "# material: ceramic    # assumed, probability 0.70: walls 2300 kg/m3" in text
    assert "material" not in reader.read(text.encode())[0].fields
    assert reader.read(proposal(stated).encode())[0].fields["material"] == "ceramic"


def test_things_of_the_room_and_lost_ones_are_told_by_their_box():
    text = proposal(element("fixture", category="room", interactive=False), element("spoon"), red_mug=["built: rigid"])
    fixture, spoon = reader.read(text.encode())
    assert (fixture.interactive, fixture.fields["box"]) == (False, BOX)
    assert spoon.interactive
    assert "no mask was found for it" in text
    assert "built: rigid" in proposal(element("red_mug"), red_mug=["built: rigid"])


def test_names_take_the_form_of_the_file():
    (read,) = reader.read(proposal(element("Big Spoon")).encode())
    assert read.name == "big_spoon"
