"""`dxb ls` with globs, `dxb show --graph` and `--trace` through the real `dxb`."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from tests.e2e.space import Space


@pytest.fixture
def built(space: Space) -> Space:
    assert space.build("say/words").code == 0
    return space


def names(space: Space, *words: str) -> list[str]:
    answer = space.dxb("ls", *words)
    assert answer.code == 0, answer.err
    return [line.split("\t")[0] for line in answer.out.splitlines()]


def test_globs_over_recipes_and_nodes(asked: Space) -> None:
    assert names(asked, "say/*:word[*].loud") == ["say/words:word[one].loud", "say/words:word[two].loud"]
    # Without labels every copy, as everywhere; brackets are no character classes.
    assert names(asked, "say/words:word.loud") == names(asked, "say/words:word[*].loud")
    assert names(asked, "say/words:word[one].*") == ["say/words:word[one].loud", "say/words:word[one].louder"]
    assert len(names(asked, "say/words:*")) == 7
    assert re.fullmatch(r"say/words:all\tcached\ttoy.join\t-\t\d\.\d\t-\n", asked.dxb("ls", "say/words:all").out)


def test_what_nodes_depend_on_and_what_depends_on_them(asked: Space) -> None:
    loud, louder = ([f"say/words:word[{word}].{name}" for word in ("one", "two")] for name in ("loud", "louder"))
    # A collection depends on what its group was opened over, too.
    assert names(asked, "say/words:all", "--deps") == ["say/words:words", *louder, "say/words:start", *loud]
    assert names(asked, "say/words:word[one].loud", "--rdeps") == [louder[0], "say/words:all"]
    assert names(asked, "say/words:word[one].louder", "--deps") == [loud[0], "say/words:words", "say/words:start"]


@pytest.mark.medium
def test_stale_and_cached(built: Space) -> None:
    assert names(built, "say/words", "--stale") == []
    assert len(names(built, "say/words", "--cached")) == 7
    built.edit("recipes/say/words.yaml", "times: 2", "times: 3")
    stale = built.dxb("ls", "say/words", "--stale", "--json").rows
    assert {row["node"]: row["status"] for row in stale} == {
        "say/words:word[one].louder": "stale",
        "say/words:word[two].louder": "stale",
        "say/words:all": "unknown",
    }


@pytest.mark.medium
def test_copies_that_are_not_known_yet_are_one_row(space: Space) -> None:
    assert names(space, "say/words:word.*") == ["say/words:word.loud", "say/words:word.louder"]
    assert names(space, "say/words:word.loud", "--deps") == ["say/words:words", "say/words:start"]
    assert names(space, "say/words:word.loud", "--rdeps") == ["say/words:word.louder", "say/words:all"]


@pytest.mark.medium
def test_of_many_recipes_one_may_need_an_input(built: Space) -> None:
    built.write(
        "recipes/say/asking.yaml", "inputs: {note: {help: A file.}}\nnodes:\n  a: {rule: toy.split, text: $note}\n"
    )
    assert len(names(built, "say/*:*")) == len(names(built, "say/words"))
    assert "error[DXB-U105]" in built.dxb("ls", "say/asking").err
    assert "say/asking\tsound, needs an input: the input `note`" in built.dxb("check", "say/asking").out
    built.edit("recipes/say/asking.yaml", "text: $note", "text: $notes")
    wrong = built.dxb("check", "say/asking")
    assert (wrong.code, wrong.out) == (2, "")
    assert "hint: did you mean `$note`?" in wrong.err


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("say/nothing:x",), "DXB-U108", "no recipe is called `say/nothing`"),
        (("say/words:lod",), "DXB-U173", "no node is called `say/words:lod`"),
        (
            ("say/*:lod",),
            "DXB-U173",
            "no node is called `say/*:lod`\n   nodes   all, start, word.loud, word.louder, words",
        ),
    ],
)
def test_what_does_not_exist_is_named(asked: Space, words: tuple[str, ...], code: str, said: str) -> None:
    answer = asked.dxb("ls", *words)
    assert answer.code == 2
    assert f"error[{code}]: {said}" in answer.err


def test_the_graph_as_json_dot_and_svg(asked: Space) -> None:
    found = asked.dxb("show", "--graph", "say/words", "--json", "--status").document
    assert (found["recipe"], found["target"], found["by"]) == ("say/words", None, "node")
    assert {node["status"] for node in found["nodes"]} == {"cached"}
    assert {"id": "start", "rule": "toy.start", "backend": None, "status": "cached", "count": 1} in found["nodes"]
    edges = {(edge["from"], edge["to"]) for edge in found["edges"]}
    assert {("start", "words"), ("words", "word[one].loud"), ("word[two].louder", "all")} <= edges
    ids = {node["id"] for node in found["nodes"]}
    assert all(source in ids and reader in ids for source, reader in edges)
    assert '"start" -> "words";' in asked.dxb("show", "--graph", "say/words", "--dot").out
    written = asked.dxb("show", "--graph", "say/words", "-o", "graph.svg").out.strip()
    assert written == "graph.svg"
    assert ET.parse(asked.root / written).getroot().tag.endswith("svg")


@pytest.mark.medium
def test_the_graph_of_a_target_and_collapsed(space: Space) -> None:
    below = space.dxb("show", "--graph", "say/words:words", "--json").document
    assert [(node["id"], node["status"]) for node in below["nodes"]] == [("start", None), ("words", None)]
    rules = space.dxb("show", "--graph", "say/words", "--json", "--by", "rule").document
    boxes = {node["id"]: (node["rule"], node["count"]) for node in rules["nodes"]}
    assert boxes == {
        f"toy.{name}": (f"toy.{name}", 2 if name == "shout" else 1) for name in ("start", "split", "shout", "join")
    }
    (whole,) = space.dxb("show", "--graph", "say/words", "--json", "--by", "recipe").document["nodes"]
    assert (whole["rule"], whole["count"]) == (None, 5)
    answer = space.dxb("show", "--graph", "say/words", "--by", "colour")
    assert (answer.code, "argument --by: invalid choice: 'colour'" in answer.err) == (2, True)
    answer = space.dxb("show", "--graph", "say/words", "-o", "no/such/folder/graph.svg")
    assert (answer.code, "cannot be written: No such file or directory" in answer.err) == (2, True)


def test_copies_that_are_new_stand_beside_those_that_were_built(built: Space) -> None:
    built.edit("recipes/say/words.yaml", "  all:", "  more: {rule: toy.join, texts: $word.loud}\n  all:")
    edges = built.dxb("show", "--graph", "say/words", "--json").document["edges"]
    assert {edge["from"] for edge in edges if edge["to"] == "more"} == {"words", "word[one].loud", "word[two].loud"}


def test_the_trace_of_a_run(asked: Space) -> None:
    events = json.loads(asked.dxb("show", "--trace").out)["traceEvents"]
    slices = {event["name"]: event["args"] for event in events if event["ph"] == "X"}
    assert set(slices) == {name.partition(":")[2] for name in names(asked, "say/words:*")}
    assert slices["start"]["memory_bytes"] > 1e6
    assert slices["start"]["rule"] == "toy.start"
    assert asked.dxb("show", "--trace", "0001", "-o", "trace.json").out.strip() == "trace.json"
    assert json.loads((asked.root / "trace.json").read_text())["otherData"]["run"] == "0001"
    assert asked.dxb("show", "--trace", "-o", "no/such/folder/x").code == 2
    assert asked.dxb("show", "--trace", "say/nothing").code == 2


@pytest.mark.parametrize(
    "words",
    [
        ("plan", "say/nothing"),
        ("why", "say/nothing:x"),
        ("show", "say/nothing"),
        ("show", "say/nothing:x"),
        ("ls", "say/nothing"),
        ("view", "say/nothing"),
        ("view", "say/nothing:x"),
        ("get", "say/nothing:x"),
        ("report", "say/nothing"),
        ("log", "say/nothing"),
        ("new", "task", "say/nothing"),
        ("check", "say/nothing"),
    ],
)
def test_every_verb_says_that_a_recipe_does_not_exist(asked: Space, words: tuple[str, ...]) -> None:
    answer = asked.dxb(*words)
    assert (answer.code, answer.out) == (2, "")
    assert "error[DXB-U108]: no recipe is called `say/nothing`" in answer.err


def test_a_recipe_that_was_never_built_is_no_scene_without_parts(asked: Space) -> None:
    answer = asked.dxb("view", "robot/kuka_leap")
    assert answer.code == 2
    assert "error[DXB-U113]: `robot/kuka_leap` was never built here" in answer.err
    assert "hint: `dxb build robot/kuka_leap`" in answer.err


def test_a_new_project_says_where_its_photograph_is_missing(tmp_path: Path) -> None:
    space = Space(tmp_path)
    assert space.dxb("init", ".").code == 0
    name = next((tmp_path / "recipes/twin").iterdir()).stem
    answer = space.dxb("plan", f"twin/{name}")
    assert answer.code == 2
    assert f"looked for: {tmp_path / 'capture'}" in answer.err
    assert "a folder with rgb.png, capture.json" in answer.err
    assert "put it there, or name another one: `--input NAME=PATH`" in answer.err
