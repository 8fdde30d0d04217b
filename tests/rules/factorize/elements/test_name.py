"""Names of the recipe: bound by phrase, property or point; what is refused; what renaming leaves alone."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.view import Instance, InstanceMap, ObjectView, Segmentation, Traits
from dextera_build.errors import RuleError
from dextera_build.geometry import pictures
from dextera_build.testing import RuleRunner
from tests import factories, object_views

COLOURS = {"blue_mug": (30, 40, 170), "red_mug": (180, 20, 20), "white_bowl": (235, 235, 235)}
CORNERS = {"blue_mug": 20, "red_mug": 120, "white_bowl": 220}
PHOTOGRAPH = np.full((240, 320, 3), 90, np.uint8)
LABELS = np.zeros((240, 320), np.int32)
for number, (thing, left) in enumerate(CORNERS.items(), start=1):
    PHOTOGRAPH[60:140, left : left + 60] = COLOURS[thing]
    LABELS[60:140, left : left + 60] = number


def proposed(*words: str) -> Segmentation:
    """The three things as a proposer calls them: the mugs and the bowl, in the order of COLOURS."""
    items = {}
    for word, thing, category in zip(words, COLOURS, ("mug", "mug", "bowl"), strict=True):
        left = CORNERS[thing]
        crop = np.s_[50:150, left - 10 : left + 70]
        view = ObjectView(
            rgb=Image(pixels=np.ascontiguousarray(PHOTOGRAPH[crop])),
            mask=np.ascontiguousarray(LABELS[crop] > 0),
            occluder=np.zeros((100, 80), bool),
            camera=factories.camera().crop(left - 10, 50, 80, 100),
            phrase=word.replace("_", " "),
        )
        traits = Traits(category=category, body_type="rigid", material="ceramic")
        items[word] = Instance(view=view, traits=traits)
    return Segmentation(items=items, names=words, map=InstanceMap(labels=LABELS, fixed=LABELS < 0))


PROPOSED = proposed(*COLOURS)


@pytest.fixture
def name(tmp_path):
    runner = RuleRunner(tmp_path)
    photograph = Photograph(rgb=Image(pixels=PHOTOGRAPH), camera=factories.camera())
    return lambda objects=PROPOSED, **names: runner.run(
        "factorize.name", photograph=photograph, objects=objects, options={"names": names}
    )


@pytest.mark.parametrize(
    "binding",
    [
        {"phrase": "Blue mug"},
        {"phrase": "blue ceramic"},
        {"category": "mug", "colour": "blue"},
        {"at_px": [25, 65]},
        {"at_px": [25, 65], "phrase": "red mug"},
    ],
)
def test_a_phrase_properties_or_a_point_bind_one_object(name, binding):
    found = name(cup=binding)
    assert found.names == ("cup", "red_mug", "white_bowl")
    np.testing.assert_array_equal(found.items["cup"].view.rgb.pixels, PROPOSED.items["blue_mug"].view.rgb.pixels)
    np.testing.assert_array_equal(found.map.labels, LABELS)


def test_without_names_everything_stays(name):
    found = name()
    assert found.names == PROPOSED.names
    assert [item.view.phrase for item in found.items.values()] == ["blue mug", "red mug", "white bowl"]


def test_a_bound_name_goes_before_the_one_of_parsing(name):
    found = name(red_mug={"colour": "blue"})
    assert found.names == ("red_mug", "red_mug_2", "white_bowl")
    assert found.items["red_mug"].view.phrase == "red mug"


def test_other_words_of_parsing_leave_a_bound_object_as_it_was(name):
    first = name(cup={"at_px": [50, 100]})
    second = name(proposed("beaker", "thing", "dish"), cup={"at_px": [50, 100]})
    assert second.names == ("cup", "thing", "dish")
    assert second.items["cup"].view.phrase == first.items["cup"].view.phrase == "cup"
    assert object_views.content(second.items["cup"]) == object_views.content(first.items["cup"])


HERE = pictures.digest_of(PHOTOGRAPH)
ELSEWHERE = pictures.digest_of(255 - PHOTOGRAPH)


def test_a_locked_point_counts_on_its_photograph_and_a_property_on_others(name):
    blue = {"at_px": [25, 65]}
    assert name(cup={"phrase": "red mug", "locked": {**blue, "photograph": HERE}}).names[0] == "cup"
    assert name(cup={"phrase": "red mug", "locked": {**blue, "photograph": ELSEWHERE}}).names[1] == "cup"
    assert name(cup={"at_px": [125, 65], "locked": {**blue, "photograph": HERE}}).names[1] == "cup"


def test_a_point_on_another_photograph_is_refused(name):
    with pytest.raises(RuleError, match="the name `cup` is bound by a point on another photograph") as caught:
        name(cup={"locked": {"at_px": [25, 65], "photograph": ELSEWHERE}})
    assert caught.value.code == "DXB-B384"
    assert set(caught.value.facts) == {"point", *COLOURS}
    assert "--at COLUMN,ROW" in caught.value.hint


@pytest.mark.parametrize(
    ("names", "message", "facts"),
    [
        ({"cup": {"phrase": "mug"}}, "2 objects fit the name `cup`", {"blue_mug", "red_mug"}),
        ({"cup": {"phrase": "green mug"}}, "no object fits the name `cup`", set(COLOURS)),
        ({"cup": {"at_px": [1, 1]}}, "no object is at the point [1, 1] of the name `cup`", set(COLOURS)),
        (
            {"cup": {"at_px": [320, 1]}},
            "the point of the name `cup` is outside the photograph",
            {"at_px", "photograph"},
        ),
        ({"cup": {}}, "the name `cup` has no property of its object", set(COLOURS)),
        (
            {"cup": {"colour": "red"}, "mug": {"at_px": [125, 70]}},
            "`cup` and `mug` are bound to the same object",
            {"red_mug"},
        ),
        ({"my cup": {"colour": "red"}}, "`my cup` is not a name", set()),
    ],
)
def test_a_name_without_exactly_one_object_is_refused(name, names, message, facts):
    with pytest.raises(RuleError) as caught:
        name(**names)
    assert (caught.value.code, caught.value.message) == ("DXB-B383", message)
    assert set(caught.value.facts) >= facts
    assert caught.value.hint
    if "blue_mug" in facts:
        assert caught.value.facts["blue_mug"] == (
            "phrase `blue mug`, category mug, material ceramic, colour blue, at_px [49, 89]"
        )
