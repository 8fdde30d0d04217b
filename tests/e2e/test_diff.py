"""`dxb diff`: runs, nodes, keys and outputs."""

from __future__ import annotations

import json

import pytest

from tests.e2e.conftest import small_project

PICTURE = '''
"""toy.picture: one colour."""
import numpy as np
from dextera_build.artifacts.cameras.image import Image
from dextera_build.rule import Context, Options, rule

class PictureOptions(Options):
    """Options."""
    red: int = 0
    """Red of one pixel."""

@rule(version=1)
def picture(ctx: Context, *, options: PictureOptions) -> Image:
    """Return a black picture with one red pixel."""
    pixels = np.zeros((9, 8, 3), np.uint8)
    pixels[2, 3, 0] = options.red
    ctx.metric("red", options.red, "counts")
    return Image(pixels=pixels)
'''


def rows(answer):
    return [line.split("\t") for line in answer.out.splitlines()]


@pytest.fixture(scope="module")
def twice(tmp_path_factory):
    """A project that was built before and after an edit, and another recipe; for all tests that only ask."""
    return built_twice(small_project(tmp_path_factory.mktemp("twice")))


def built_twice(space):
    assert space.build("say/words").code == 0
    space.edit("recipes/say/words.yaml", "text: one two", "text: one three")
    assert space.build("say/words").code == 0
    space.write("recipes/say/other.yaml", "nodes: {a: {rule: toy.start}}\n")
    assert space.build("say/other").code == 0
    return space


def test_a_recipe_alone_compares_its_last_two_runs(twice):
    answer = twice.dxb("diff", "say/words")
    assert answer.code == 0
    found = rows(answer)
    assert ["start", "option", "text", "one two -> one three"] in found
    assert ["start", "output", "data"] in [row[:3] for row in found]
    assert ["words", "output", "items[two]"] in [row[:3] for row in found]
    assert ["word[two].loud", "only", "word[two].loud", "gone"] in found
    assert ["word[three].loud", "only", "word[three].loud", "new"] in found
    assert not [row for row in found if row[0] == "word[one].loud"]
    assert found == rows(twice.dxb("diff", "0001", "0002"))
    assert answer.err.splitlines()[0].endswith("nodes differ"), "the sentence comes first"


def test_json_has_the_same(twice):
    told = twice.dxb("diff", "--json", "0001", "0002").document
    assert (told["old"], told["new"]) == ("0001", "0002")
    start = next(node for node in told["differences"] if node["node"] == "start")
    unknown = dict.fromkeys(("largest", "changed", "total", "motion"))
    assert start["rows"][0] == {"kind": "option", "name": "text", "change": "one two -> one three", **unknown}


def test_a_node_alone_compares_its_last_two_runs(twice):
    answer = twice.dxb("diff", "say/words:all")
    assert [row[:2] for row in rows(answer)] == [["input", "texts"], ["output", "data"]]
    assert rows(answer) == rows(twice.dxb("diff", "0001:all", "0002:all"))


def test_equal_things_print_nothing(twice):
    answer = twice.dxb("diff", "0001:word[one].loud", "0002:word[one].loud")
    assert (answer.code, answer.out) == (0, "")
    assert "0001:word[one].loud and 0002:word[one].loud are equal" in answer.err


def test_two_nodes_and_their_digests(twice):
    one, two = (twice.dxb("show", "--json", f"say/words:{n}").document for n in ("word[one].loud", "word[three].loud"))
    by_name = rows(twice.dxb("diff", "say/words:word[one].loud", "say/words:word[three].loud"))
    assert [row[:2] for row in by_name] == [["input", "text"], ["output", "data"]]
    assert rows(twice.dxb("diff", one["key"][:10], two["key"][:10])) == by_name
    assert rows(twice.dxb("diff", one["output"][:10], two["output"][:10])) == by_name[1:]


def test_arrays_and_metrics(space):
    space.write("rules/toy/picture.py", PICTURE.lstrip())
    space.write(
        "recipes/say/picture.yaml", "nodes:\n  a: {rule: toy.picture, red: 10}\n  b: {rule: toy.picture, red: 200}\n"
    )
    assert space.build("say/picture").code == 0
    found = rows(space.dxb("diff", "say/picture:a", "say/picture:b"))
    assert found[0] == ["option", "red", "10 -> 200"]
    assert found[1] == ["output", "pixels", "uint8 (9, 8, 3): 1 of 216 differ, by 190 at most"]
    assert found[2] == ["metric", "red", "10 counts -> 200 counts"]


def test_a_failed_node_is_told(space):
    recipe = "nodes:\n  a: {rule: toy.start}\n  b: {rule: toy.slow, text: $a, do: work}\n"
    space.write("recipes/say/two.yaml", recipe)
    assert space.build("say/two").code == 0
    space.edit("recipes/say/two.yaml", "do: work", "do: fail")
    assert space.build("say/two").code == 1
    assert ["b", "status", "status", "ran -> failed"] in rows(space.dxb("diff", "say/two"))


def test_what_was_lost_is_told(space):
    shown = built_twice(space).dxb("show", "--json", "say/words:all").document
    for digest in (shown["key"], shown["output"]):
        (space.root / "cache" / "cas" / digest[:2] / digest[2:]).unlink()
    found = rows(space.dxb("diff", "0001:all", "0002:all"))
    assert [row[:2] for row in found] == [["lost", "key"], ["lost", "output"]]


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["0001", "0001:all"], "DXB-U164"),
        (["say/other"], "DXB-U165"),
        (["0001:al", "0001:all"], "DXB-U166"),
        (["abcdef0123", "0001:all"], "DXB-U167"),
        (["say/nothing", "0001"], "DXB-U108"),
        (["say/words:nothing", "0001:all"], "DXB-U110"),
        (["0099", "0001"], "DXB-U112"),
    ],
)
def test_what_names_nothing_is_refused(twice, words, code):
    answer = twice.dxb("diff", *words)
    assert answer.code == 2
    assert f"error[{code}]" in answer.err


def test_bytes_that_are_neither_key_nor_artifact_are_refused(twice):
    header = twice.dxb("show", "--json", "say/words:all").document["output"]
    blob = json.loads((twice.root / "cache/cas" / header[:2] / header[2:]).read_bytes())["fields"]["data"]["$bytes"][0]
    answer = twice.dxb("diff", blob[:12], header[:12])
    assert answer.code == 2
    assert "error[DXB-U168]" in answer.err
