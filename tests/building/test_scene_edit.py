"""Changes in the text of a `scene.yaml`: what people wrote stays, in whatever style it is written."""

from __future__ import annotations

import pytest
import yaml

from dextera_build.building import scene_edit
from dextera_build.errors import UsageError

BLOCK = """# mine
elements:
  - name: tea    # green
    phrase: green tea tin
    at_px: [412, 233]
    # 3 faces
  # the old mug
  - name: mug
    box:
      - 1
      - 2
      - 30
      - 40
    material: ceramic
  - {name: pen, at_px: [5, 6]}
"""
FLOW = (
    "elements: [{name: tea, phrase: green tea tin, at_px: [412, 233]}, "
    "{name: mug, box: [1, 2, 30, 40], material: ceramic}, {name: pen, at_px: [5, 6]}]\n"
)
STYLES = pytest.mark.parametrize("text", [BLOCK, FLOW, BLOCK.rstrip()], ids=["block", "flow", "without an end"])


def read(text: str) -> dict[str, dict[str, object]]:
    return {each["name"]: each for each in yaml.safe_load(text)["elements"]}


@STYLES
@pytest.mark.parametrize("name", ["tea", "mug", "pen"])
def test_fields_are_set_added_and_removed(text, name):
    before = read(text)
    made = scene_edit.changed(text, name, {"at_px": [[1, 2], [3, 4]], "box": None, "category": "box"})
    after = read(made)
    assert after[name] == {
        **{key: value for key, value in before[name].items() if key != "box"},
        "at_px": [[1, 2], [3, 4]],
        "category": "box",
    }
    assert {key: value for key, value in after.items() if key != name} == {
        key: value for key, value in before.items() if key != name
    }
    assert made.count("#") == text.count("#")
    assert "at_px: [[1, 2], [3, 4]]" in made.splitlines()[scene_edit.line_of(made, name, "at_px") - 1]


@STYLES
@pytest.mark.parametrize("name", ["tea", "mug", "pen"])
def test_an_element_is_removed_and_another_added(text, name):
    before = read(text)
    made = scene_edit.removed(text, name)
    assert read(made) == {key: value for key, value in before.items() if key != name}
    after = read(scene_edit.added(text, name, {"name": "new", "at_px": [7, 8]}))
    assert after == {**before, "new": {"name": "new", "at_px": [7, 8]}}
    assert list(after).index("new") == list(after).index(name) + 1


def test_comments_inside_an_element_go_with_it_and_others_stay():
    made = scene_edit.removed(BLOCK, "tea")
    assert made.startswith("# mine\nelements:\n  # the old mug\n  - name: mug\n")
    assert "    # 3 faces\n  - name: tin\n" in scene_edit.added(BLOCK, "tea", {"name": "tin", "at_px": [7, 8]})


@pytest.mark.parametrize(
    ("text", "name", "code"),
    [
        ("elements: [", "tea", "DXB-U221"),
        ("things: []", "tea", "DXB-U221"),
        (BLOCK, "cup", "DXB-U221"),
        ("elements:\n- box: [1, 2, 3, 4]\n  name: tea\n", "tea", "DXB-U222"),
    ],
)
def test_what_cannot_be_changed_in_place_is_refused(text, name, code):
    with pytest.raises(UsageError) as caught:
        scene_edit.changed(text, name, {"box": None})
    assert caught.value.code == code
