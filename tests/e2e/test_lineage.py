"""`dxb show --lineage`: all that a result came from, down to project files."""

from __future__ import annotations

import hashlib
import shutil
from typing import Any

import pytest

from tests.e2e.conftest import small_project
from tests.e2e.space import Space

PHOTO = '''
"""toy.photo: a capture as one file."""
from dextera_build.artifacts.base import Artifact, File, Folder
from dextera_build.rule import Context, Options, rule

class Capture(Artifact):
    """What was seen."""
    rgb: File
    """Pixels."""
    depth: File
    """Metres."""

class PhotoOptions(Options):
    """Options."""
    gain: float = 1.0
    """A factor."""
    noise_seed: int = 3
    """Seed of the noise."""

@rule(version=2, packages=("numpy",))
def photo(ctx: Context, folder: Folder, *, options: PhotoOptions) -> Capture:
    """Return the capture."""
    return Capture(rgb=File(data=folder.files["rgb.png"]), depth=File(data=folder.files["depth.png"]))
'''
RECIPE = """inputs: {capture: captures/table, note: note.txt}
nodes:
  photo: {rule: toy.photo, folder: $capture, gain: 2.5}
  words: {rule: toy.split, text: $photo.rgb}
  word:
    each: $words
    as: word
    nodes:
      loud: {rule: toy.shout, text: $word, more: $note}
  all: {rule: toy.join, texts: $word.loud}
  said: {rule: toy.spoken, text: $all}
targets: {default: [said], early: [words]}
"""


def sha(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> Space:
    """A built project for all tests that only ask."""
    return _built(small_project(tmp_path_factory.mktemp("told")))


@pytest.fixture
def seen(space: Space) -> Space:
    return _built(space)


def _built(space: Space) -> Space:
    space.write("rules/toy/photo.py", PHOTO.lstrip())
    space.write("recipes/say/seen.yaml", RECIPE)
    space.write("captures/table/rgb.png", "one two")
    space.write("captures/table/depth.png", "0.5")
    space.write("note.txt", "soon")
    answer = space.build("say/seen")
    assert answer.code == 0, answer.err
    return space


def lineage(space: Space, *words: str) -> dict[str, Any]:
    answer = space.dxb("show", "--lineage", "--json", *words)
    assert answer.code == 0, answer.err
    return answer.document


def by_name(found: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {node.get("node") or node.get("path") or "?": node for node in found["nodes"]}


def reads(found: dict[str, Any]) -> set[tuple[str, str, str]]:
    """(reader, slot, source with part)."""
    names = {node["id"]: node.get("node") or node.get("path") or "?" for node in found["nodes"]}
    return {(names[edge["to"]], edge["slot"], names[edge["from"]] + edge["part"]) for edge in found["edges"]}


ALL = {
    ("said", "text", "all"),
    ("all", "texts[one]", "word[one].loud"),
    ("all", "texts[two]", "word[two].loud"),
    ("word[one].loud", "text", "words.items[one]"),
    ("word[two].loud", "text", "words.items[two]"),
    ("word[one].loud", "more", "note.txt"),
    ("word[two].loud", "more", "note.txt"),
    ("words", "text", "photo.rgb"),
    ("photo", "folder", "captures/table"),
}


def test_every_node_and_file_is_there_once(told):
    found = lineage(told, "say/seen:said")
    assert reads(found) == ALL
    assert len({node["id"] for node in found["nodes"]}) == len(found["nodes"]) == 8
    nodes = by_name(found)
    assert found["roots"] == [nodes["said"]["key"]]
    photo = nodes["photo"]
    assert (photo["rule"], photo["version"], photo["backend"]) == ("toy.photo", 2, None)
    assert photo["options"] == {"gain": 2.5, "noise_seed": 3}
    assert {"numpy", "platform", "python"} <= set(photo["packages"])
    assert set(photo["code"]["files"]) >= {
        "dextera_build/artifacts/__init__.py",
        "dextera_build/artifacts/base.py",
        "rules/toy/photo.py",
    }
    assert "rules/toy/shout.py" not in photo["code"]["files"]
    assert set(nodes["word[one].loud"]["code"]["files"]) >= {"rules/toy/marks.py", "rules/toy/shout.py"}
    assert nodes["said"]["backend"] == "quiet"
    assert nodes["captures/table"]["files"] == {"rgb.png": sha("one two"), "depth.png": sha("0.5")}
    assert nodes["note.txt"]["files"] == {"": sha("soon")}


def test_text_is_indented_and_tells_shared_things_once(told):
    lines = told.dxb("show", "--lineage", "say/seen:said").out.splitlines()
    assert lines[0].startswith("say/seen:said\ttoy.spoken version 1\tquiet\tkey ")
    cells = [line.strip().split("\t") for line in lines]
    assert [cell[0] for cell in cells].count("option gain") == 1
    assert ["option gain", "2.5"] in cells
    assert ["option noise_seed", "3"] in cells
    assert ["rgb.png", f"sha256 {sha('one two')}"] in cells
    assert ["more <- note.txt", "file", f"sha256 {sha('soon')}"] in cells
    assert ["more <- note.txt", "(above)"] in cells
    assert ["text <- words.items[two]", "(above)"] in cells
    (folder,) = [line for line in lines if "folder <- captures/table" in line]
    (photo,) = [line for line in lines if "text <- photo.rgb" in line]
    assert len(folder) - len(folder.lstrip()) == len(photo) - len(photo.lstrip()) + 2


def test_it_tells_of_the_build_and_not_of_the_recipe_as_it_is_now(seen):
    seen.edit("recipes/say/seen.yaml", "gain: 2.5", "gain: 4.5")
    seen.edit("recipes/say/seen.yaml", "captures/table, note: note.txt", "captures/chair, note: other.txt")
    seen.write("note.txt", "later")
    shutil.rmtree(seen.root / "captures")
    seen.write("captures/chair/rgb.png", "x")
    seen.write("other.txt", "x")
    found = lineage(seen, "say/seen:said")
    assert reads(found) == ALL
    assert by_name(found)["photo"]["options"]["gain"] == 2.5
    assert by_name(found)["note.txt"]["files"] == {"": sha("soon")}


def test_targets_stand_for_their_nodes(told):
    assert by_name(lineage(told, "say/seen"))["said"]["rule"] == "toy.spoken"
    assert set(by_name(lineage(told, "say/seen:early"))) == {"words", "photo", "captures/table"}
    copies = lineage(told, "say/seen:word.loud")
    assert len(copies["roots"]) == 2
    answer = told.dxb("show", "--lineage", "say/seen:nothing")
    assert answer.code == 2
    assert "has no node `nothing`" in answer.err


def test_what_was_never_built_says_how(space):
    answer = space.dxb("show", "--lineage", "say/words")
    assert answer.code == 2
    assert "was never built here" in answer.err
    assert "hint: `dxb build 'say/words:all'`" in answer.err


@pytest.mark.medium
def test_what_the_store_lacks_says_what_to_do(seen):
    keys = {name: node["key"] for name, node in by_name(lineage(seen, "say/seen:said")).items() if "key" in node}
    (seen.root / "cache" / "ac" / keys["words"][:2] / keys["words"][2:]).unlink()
    lines = seen.dxb("show", "--lineage", "say/seen:said").out
    again = "`dxb build 'say/seen:words'` makes it again"
    assert f"missing\tits result is not in the store; {again}" in lines
    (seen.root / "cache" / "ac" / keys["photo"][:2] / keys["photo"][2:]).unlink()
    assert seen.dxb("show", "--lineage", "say/seen:words").code == 0
    assert seen.build("say/seen:words").code == 0
    assert "missing" not in seen.dxb("show", "--lineage", "say/seen:said").out


def test_what_no_log_tells_of_is_said(seen):
    shutil.rmtree(seen.root / "cache" / "runs")
    found = lineage(seen, "say/seen:words")
    (unknown,) = [node for node in found["nodes"] if node["kind"] == "unknown"]
    assert unknown["missing"] == (
        "the store has no record of its origin; `dxb build 'say/seen' --force 'words'` reads or makes it again"
    )


def test_the_whole_recipe_is_known_after_a_build_of_a_part(space: Space) -> None:
    """A later run of some targets hides nothing that verbs read of the recipe, but copies that went."""
    assert space.build("say/words").code == 0
    assert space.build("say/words:start").code == 0
    assert "all" in by_name(lineage(space, "say/words"))
    assert "word[two].loud" in by_name(lineage(space, "say/words:word.loud"))
    space.edit("recipes/say/words.yaml", "text: one two", "text: one")
    assert space.build("say/words:word").code == 0
    found = by_name(lineage(space, "say/words:word.loud"))
    assert ("word[one].loud" in found, "word[two].loud" in found) == (True, False)
