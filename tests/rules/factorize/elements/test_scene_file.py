"""Strictness of `scene.yaml`: every error with its line and column."""

from __future__ import annotations

import importlib

import pytest

from dextera_build.artifacts.objects.object import Element
from dextera_build.code.loader import Library
from dextera_build.errors import RuleError

Library().find("factorize.parse")
scene_file = importlib.import_module("rules.factorize.elements.scene_file")
matching = importlib.import_module("rules.factorize.elements.matching")


def test_a_whole_element_is_read():
    text = b"""
elements:
  - name: coffee_mug          # one a line
    phrase: a blue mug
    category: mug
    body_type: rigid
    material: ceramic
    box: [1, 2, 30, 40]
    interactive: true
"""
    (element,) = scene_file.read(text)
    assert element.fields["box"] == (1, 2, 30, 40)
    assert element.interactive
    assert (element.place.line, element.place.column) == (3, 5)


@pytest.mark.medium
@pytest.mark.parametrize(
    ("text", "message", "place"),
    [
        ("elements: [", "not valid YAML", "$scene:1"),
        ("elements:\n  - {name: a\n", "not valid YAML", "$scene:3"),
        ("", "`elements` must list at least one element", "$scene"),
        ("elements: []", "`elements` must list at least one element", "$scene:1:11"),
        ("things: []", "`things` is not known here", "$scene:1:1"),
        ("elements:\n- {name: a, phrase: x, phrase: y}", "`phrase` is given twice", "$scene:2:24"),
        ("elements:\n- {name: a, colour: red}", "`colour` is not known here", "$scene:2:13"),
        ("elements:\n- {phrase: a mug}", "an element has no `name`", "$scene:2:3"),
        ("elements:\n- {name: Blue Mug}", "`Blue Mug` is not a name", "$scene:2:10"),
        ("elements:\n- {name: a, category: cup}", "`cup` is not a category", "$scene:2:23"),
        ("elements:\n- {name: a, body_type: soft}", "`soft` is not a body_type", "$scene:2:24"),
        ("elements:\n- {name: a, material: plastc}", "`plastc` is not a material", "$scene:2:23"),
        ("elements:\n- {name: a, box: [1, 2, 3]}", "`box` must be four whole numbers", "$scene:2:18"),
        ("elements:\n- {name: a, at_px: [1, 2, 3]}", "`at_px` must be two whole numbers", "$scene:2:20"),
        ("elements:\n- {name: a, at_px: 1}", "`at_px` must be two whole numbers", "$scene:2:20"),
        ("elements:\n- {name: a, at_px: [-1, 2]}", "`at_px` must be two whole numbers", "$scene:2:20"),
        ("elements:\n- {name: a, box: [9, 2, 3, 8]}", "`box` is empty", "$scene:2:18"),
        ("elements:\n- {name: a, interactive: yes}", "`interactive` must be `true` or `false`", "$scene:2:26"),
        ("elements:\n- {name: a, phrase: [x]}", "`phrase` must be a word or a phrase", "$scene:2:21"),
        ("elements:\n- mug", "a mapping with", "$scene:2:3"),
        ("elements:\n- {name: a, [1]: b}", "a field's name is a word", "$scene:2:13"),
        ("[" * 100_000, "the file is nested too deeply", "$scene"),
        ("elements:\n- {name: a, joints: hinge}", "`joints` must list at least one joint", "$scene:2:21"),
        ("elements:\n- {name: a, joints: [{at_deg: 1}]}", "a joint has no `type`", "$scene:2:22"),
        ("elements:\n- {name: a, joints: [{type: slide}]}", "a slide has no `part_px`", "$scene:2:22"),
        (
            "elements:\n- {name: a, joints: [{type: hinge, at_deg: 30}]}",
            "a hinge has `at_deg` but no `part_px`",
            "$scene:2:44",
        ),
        (
            "elements:\n- {name: a, joints: [{type: slide, part_px: [1, 2, 3, 4]}, {type: hinge}]}",
            "a hinge without `part_px` is one of several joints",
            "$scene:2:60",
        ),
        (
            "elements:\n- {name: a, joints: [{type: lid, part_px: [1, 2, 3, 4]}]}",
            "`lid` is no joint",
            "$scene:2:29",
        ),
        (
            "elements:\n- {name: a, joints: [{type: hinge, part_px: [1, 2, 3, 4]}]}",
            "a hinge has no `axis_px`",
            "$scene:2:22",
        ),
        (
            "elements:\n- {name: a, joints: [{type: slide, part_px: [1, 2, 3, 4], range_deg: [0, 9]}]}",
            "a slide has no `range_deg`",
            "$scene:2:70",
        ),
        (
            "elements:\n- {name: a, joints: [{type: slide, part_px: [1, 2, 3, 4], range_mm: [9, 0]}]}",
            "the range is empty",
            "$scene:2:69",
        ),
        (
            "elements:\n- {name: a, joints: [{type: slide, part_px: [1, 2, 3, 4], range_mm: [0, 9], at_mm: 20}]}",
            "the joint is at 20 mm, outside its range",
            "$scene:2:22",
        ),
        ("elements:\n- {name: a}\n- {name: a}", "the name `a` is given twice", "$scene:3:3"),
    ],
)
def test_an_error_names_line_and_column(text, message, place):
    with pytest.raises(RuleError) as caught:
        scene_file.read(text.encode())
    assert caught.value.message.startswith(message)
    assert str(caught.value.where).startswith(place)


def test_what_is_no_text_is_refused():
    with pytest.raises(RuleError, match="is not UTF-8 text"):
        scene_file.read(b"\xff\xfe\x00")


def test_a_near_miss_gets_a_hint():
    with pytest.raises(RuleError) as caught:
        scene_file.read(b"elements:\n- {name: a, material: plastc}")
    assert caught.value.hint == "did you mean `plastic`?"


def test_words_that_fit_two_proposals_match_none():
    proposals = [
        Element(name=name, category="box", phrase="red box", box=(i, 0, i + 9, 9))
        for i, name in enumerate(["red_box", "red_box_2"])
    ]
    wanted = scene_file.read(b"elements:\n- {name: cereal, phrase: red box}")
    with pytest.raises(RuleError, match="`cereal` matches 2 things equally: red_box, red_box_2") as caught:
        matching.match(wanted, proposals, 0.3)
    assert "at_px: [column, row]" in (caught.value.hint or "")


def test_without_a_backend_that_proposes_boxes_count_as_they_are():
    text = b"elements:\n- {name: red_mug, category: mug, box: [1, 2, 30, 40]}\n- {name: wall, category: room}"
    mug, wall = matching.boxed(scene_file.read(text))
    assert (mug.box, mug.category, mug.phrase, mug.interactive) == ((1, 2, 30, 40), "mug", "red mug", True)
    assert (wall.box, wall.interactive) == (None, False)
    with pytest.raises(RuleError, match="`mug` has no box") as caught:
        matching.boxed(scene_file.read(b"elements:\n- {name: mug}"))
    assert (caught.value.code, str(caught.value.where)) == ("DXB-B204", "$scene:2:3")
    assert caught.value.hint == "give it the `box` of its pixels: [left, top, right, bottom], right and bottom excluded"


def test_another_name_leaves_the_phrase_that_was_proposed():
    proposal = Element(name="blue_mug", category="mug", phrase="blue mug", box=(0, 0, 9, 9))
    texts = [f"elements:\n- {{name: {name}, box: [0, 0, 9, 9]}}" for name in ("a", "b")]
    found = [matching.match(scene_file.read(text.encode()), [proposal], 0.3)[0] for text in texts]
    assert [element.phrase for element in found] == ["blue mug", "blue mug"]


def test_a_static_element_needs_no_proposal():
    wanted = scene_file.read(b"elements:\n- {name: wall, category: room}")
    (element,) = matching.match(wanted, [], 0.3)
    assert not element.interactive
    assert element.category == "room"


TWO = [Element(name=f"red_box_{i}", category="box", phrase="red box", box=(10 * i, 0, 10 * i + 9, 9)) for i in (1, 2)]


def wanted_at(*points: tuple[int, int]):
    lines = [f"- {{name: a{i}, at_px: [{column}, {row}]}}" for i, (column, row) in enumerate(points)]
    return scene_file.read(("elements:\n" + "\n".join(lines)).encode())


def test_a_point_matches_what_has_its_pixel():
    first, second = matching.match(wanted_at((22, 3), (12, 3)), TWO, 0.3)
    assert [(e.name, e.box) for e in (first, second)] == [("a0", TWO[1].box), ("a1", TWO[0].box)]
    with pytest.raises(RuleError, match="`a0` matches nothing") as caught:
        matching.match(wanted_at((19, 8)), TWO, 0.3)
    assert (caught.value.code, caught.value.facts["wanted"]) == ("DXB-B204", "at_px [19, 8]")
    with pytest.raises(RuleError, match="`a1` matches nothing") as caught:
        matching.match(wanted_at((12, 3), (13, 4)), TWO, 0.3)
    assert caught.value.facts["taken"] == "red_box_1"


def test_of_overlapping_boxes_the_mask_at_the_point_decides_else_the_smaller_box():
    large = Element(name="tray", category="object", phrase="tray", box=(0, 0, 40, 40))
    (element, *_) = matching.match(wanted_at((12, 3)), [large, *TWO], 0.3)
    assert element.box == TWO[0].box
    (element, *_) = matching.match(wanted_at((12, 3)), [large, *TWO], 0.3, at=lambda point: large.box)
    assert element.box == large.box
    with pytest.raises(RuleError, match="`a0` matches nothing"):
        matching.match(wanted_at((12, 3)), [large, *TWO], 0.3, at=lambda point: None)


@pytest.mark.parametrize(
    "place", ["at_px: [640, 3]", "at_px: [3, 480]", "box: [640, 3, 700, 9]", "box: [0, 480, 9, 490]"]
)
def test_a_place_outside_the_photograph_is_refused_with_its_size(place):
    wanted = scene_file.read(f"elements:\n- {{name: a, {place}}}".encode())
    with pytest.raises(RuleError, match="of `a` is outside the photograph") as caught:
        scene_file.inside(wanted, 640, 480)
    assert caught.value.facts["photograph"] == "640 x 480 px"
    assert str(caught.value.where) == "$scene:2:3"


def test_without_a_backend_that_proposes_a_point_is_not_enough():
    with pytest.raises(RuleError, match="`a0` has no box: nothing is proposed at its point"):
        matching.boxed(wanted_at((12, 3)))


def test_joints_are_read_in_radians_and_metres_and_make_an_element_articulated():
    text = b"""
elements:
  - name: cupboard
    box: [10, 10, 300, 300]
    joints:
      - {type: hinge, part_px: [20, 20, 120, 220], axis_px: [[20, 20], [20, 220]], range_deg: [0, 90], at_deg: 30}
      - {type: slide, part_px: [20, 230, 120, 290], range_mm: [0, 200]}
"""
    (element,) = matching.boxed(scene_file.read(text))
    assert element.body_type == "articulated"
    door, drawer = element.joints
    assert (door.type, drawer.type) == ("revolute", "prismatic")
    assert door.axis_px == ((20.0, 20.0), (20.0, 220.0))
    assert door.position == pytest.approx(0.5236, abs=1e-4)
    assert door.range == pytest.approx((0.0, 1.5708), abs=1e-4)
    assert drawer.range == pytest.approx((0.0, 0.2))


def test_a_hinge_of_which_nothing_else_is_said_is_sought_in_the_shape():
    (element,) = matching.boxed(
        scene_file.read(b"elements:\n- {name: a, box: [1, 2, 30, 40], joints: [{type: hinge}]}")
    )
    assert element.body_type == "articulated"
    assert element.joints == ()


def test_several_things_that_fill_a_box_together_are_one_and_small_ones_within_it_are_parts():
    halves = [Element(name=n, category="box", phrase="box", box=(x, 10, x + 45, 30)) for n, x in (("a", 10), ("b", 57))]
    fragment = Element(name="c", category="box", phrase="box", box=(40, 22, 60, 31))
    beside = Element(name="d", category="box", phrase="box", box=(200, 10, 240, 30))
    wanted = scene_file.read(b"elements:\n- {name: scissors, box: [8, 8, 105, 33]}")
    found = matching.match(wanted, [*halves, fragment, beside], 0.5)
    assert [(each.name, each.box, each.interactive) for each in found] == [
        ("scissors", (8, 8, 105, 33), True),
        ("d", beside.box, False),
    ]


def test_a_large_thing_within_a_wanted_box_stays_a_thing_of_its_own():
    whole = Element(name="a", category="box", phrase="box", box=(0, 0, 100, 100))
    large = Element(name="b", category="box", phrase="box", box=(10, 10, 90, 80))
    wanted = scene_file.read(b"elements:\n- {name: tray, box: [0, 0, 100, 100]}")
    assert [each.name for each in matching.match(wanted, [whole, large], 0.5)] == ["tray", "b"]
