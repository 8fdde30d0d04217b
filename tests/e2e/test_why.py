"""`dxb why` names each cause with its file and line."""

from __future__ import annotations

import os
import time

import pytest

from dextera_build.code.modules import PACKAGE

READ = '''
"""toy.read: a folder as one file."""
from dextera_build.artifacts.base import File, Folder
from dextera_build.rule import Context, rule

@rule(version=1)
def read(ctx: Context, notes: Folder) -> File:
    """Return all files, one after another."""
    return File(data=b" ".join(data for _, data in sorted(notes.files.items())))
'''
NOTES = """inputs: {notes: notes}
nodes:
  text: {rule: toy.read, notes: $notes}
  words: {rule: toy.split, text: $text}
  word:
    each: $words
    as: word
    nodes:
      loud: {rule: toy.shout, text: $word}
  all: {rule: toy.join, texts: $word.loud}
  end: {rule: toy.shout, text: $all, times: 3}
targets: {default: [end]}
"""


def causes(answer) -> list[tuple[int, str, str]]:
    """(depth, kind, name) of every line."""
    return [(row["depth"], row["kind"], row["name"]) for row in answer.document["causes"]]


@pytest.fixture
def notes(space):
    space.write("rules/toy/read.py", READ.lstrip())
    space.write("recipes/say/notes.yaml", NOTES)
    space.write("notes/a.txt", "one")
    space.write("notes/b.txt", "two")
    assert space.build("say/notes").code == 0
    return space


@pytest.fixture
def built(space):
    assert space.build("say/words").code == 0
    return space


@pytest.mark.medium
def test_a_recipe_lists_every_stale_node_with_its_cause(built):
    answer = built.dxb("why", "say/words")
    assert (answer.code, answer.out, answer.err) == (0, "", "say/words is up to date\n")
    built.edit("recipes/say/words.yaml", "times: 2", "times: 3")
    answer = built.dxb("why", "say/words")
    assert answer.code == 0
    rows = dict(line.split("\t") for line in answer.out.splitlines())
    assert set(rows) == {"word[one].louder", "word[two].louder"}
    assert all("option times 2 -> 3" in why.replace("→", "->") for why in rows.values())
    assert answer.err == "2 nodes of say/words would run, 1 may follow\n"


def test_up_to_date(asked):
    answer = asked.dxb("why", "say/words:word[one].loud")
    assert answer.out.startswith("up to date: key ")
    assert ", since run 0001 (" in answer.out


def test_a_run_that_found_a_result_is_not_said_to_have_built_it(space):
    space.write("recipes/say/again.yaml", (space.root / "recipes" / "say" / "words.yaml").read_text())
    assert space.dxb("build", "say/words").code == 0
    assert space.dxb("build", "say/again").code == 0
    answer = space.dxb("why", "say/again:all")
    assert "since run 0002 (" in answer.out
    assert "built" not in answer.out


def test_never_built(space):
    assert space.dxb("why", "say/words:start").out.startswith("never built")


def test_an_option_is_named_with_its_line(built):
    built.edit("recipes/say/words.yaml", "text: one two", "text: three")
    answer = built.dxb("why", "say/words:start")
    assert answer.out.splitlines()[0].startswith("stale: 1 thing it depends on changed since run 0001")
    assert answer.out.splitlines()[1] == "  option\ttext\tone two -> three\trecipes/say/words.yaml:3:34"


def test_a_request_that_was_never_built_is_compared_with_the_one_built_last(space):
    changed = ("--profile", "stub", "--set", "start.text=three")
    assert space.build("say/words", "--profile", "stub").code == 0
    answer = space.dxb("why", "say/words:start", *changed)
    assert answer.out.splitlines()[1].startswith("  option\ttext\tone two -> three")
    assert space.build("say/words", *changed).code == 0
    answer = space.dxb("why", "say/words:start", "--profile", "stub", "--set", "start.text=four")
    assert answer.out.splitlines()[1].startswith("  option\ttext\tthree -> four")


def test_a_moved_statement_is_told_as_a_change_of_order(space):
    space.edit("rules/toy/marks.py", "def mark", "SIGNS = {}\nSIGN = SIGNS.get(1)\nSIGNS.update({})\n\ndef mark")
    assert space.build("say/words").code == 0
    space.edit("rules/toy/marks.py", "SIGN = SIGNS.get(1)\nSIGNS.update({})", "SIGNS.update({})\nSIGN = SIGNS.get(1)")
    (cause,) = space.dxb("why", "--json", "say/words:word[two].loud").document["causes"]
    assert (cause["kind"], cause["name"]) == ("code", "order of statements of rules/toy/marks.py")
    assert cause["change"] == "SIGN <module> -> <module> SIGN"


@pytest.mark.medium
def test_another_version_of_an_imported_package_makes_stale_what_reaches_it(space):
    space.edit("rules/toy/marks.py", "def mark", "def seen():\n    import cv2\n\ndef mark")
    assert space.build("say/words").code == 0
    metadata = "Metadata-Version: 2.1\nName: opencv-python-headless\nVersion: 99.9\n"
    space.write("newer/opencv_python_headless-99.9.dist-info/METADATA", metadata)
    newer = {"PYTHONPATH": os.pathsep.join([str(PACKAGE.parent), str(space.root / "newer")])}
    rows = space.dxb("plan", "--json", "say/words", env=newer).rows
    found = {row["node"]: row["status"] for row in rows}
    assert {node for node, status in found.items() if status == "stale"} == {"word[one].loud", "word[two].loud"}
    assert {node for node, status in found.items() if status == "cached"} == {"start", "words"}
    (cause,) = space.dxb("why", "--json", "say/words:word[two].loud", env=newer).document["causes"]
    assert (cause["kind"], cause["name"]) == ("package", "opencv-python-headless")
    assert cause["change"].endswith(" -> 99.9")


def test_a_changed_helper_is_named_with_function_and_line(built):
    built.edit("rules/toy/marks.py", 'b"!" * times', 'b"?" * times')
    for _ in range(2):  # the second command repeats the plan of the first
        time.sleep(0.05)
        answer = built.dxb("why", "--json", "say/words:word[two].loud").document
        (cause,) = answer["causes"]
        assert cause["kind"] == "code"
        assert cause["name"] == "`mark` of rules/toy/marks.py"
        assert cause["place"] == "rules/toy/marks.py:3"


def test_what_waits_for_a_stale_node_says_so(built):
    built.edit("recipes/say/words.yaml", "text: one two", "text: three")
    answer = built.dxb("why", "say/words:words")
    assert answer.out.splitlines()[0].startswith("may be stale")
    assert "waits for\tstart" in answer.out


def test_an_evicted_result_is_told_apart(built):
    for file in (built.root / "cache/ac").rglob("*"):
        if file.is_file():
            file.unlink()
    assert "the store no longer holds it" in built.dxb("why", "say/words:start").out


def test_an_unknown_node_lists_the_known(asked):
    answer = asked.dxb("why", "say/words:strat")
    assert answer.code == 2
    assert "`say/words` has no node `strat`" in answer.err
    assert "did you mean `start`?" in answer.err


def test_a_copy_whose_group_is_not_open_again_may_be_stale(built):
    built.edit("recipes/say/words.yaml", "text: one two", "text: three")
    answer = built.dxb("why", "say/words:word[one].loud")
    assert answer.code == 0
    assert answer.out.splitlines()[0].startswith("may be stale")
    never = built.dxb("why", "say/words:word[nine].loud")
    assert never.code == 2
    assert "does not exist yet: the collection of its group is not built" in never.err


def test_a_changed_file_is_named(space):
    space.write("note.txt", "one two")
    space.write("recipes/say/note.yaml", "inputs: {note: note.txt}\nnodes:\n  w: {rule: toy.split, text: $note}\n")
    assert space.build("say/note").code == 0
    space.write("note.txt", "one three")
    (line,) = space.dxb("why", "say/note:w").out.splitlines()[1:]
    assert line.startswith("  input\ttext\t")
    assert line.endswith("\tnote.txt")


def test_a_changed_input_names_the_call_that_it_comes_from(built):
    built.edit("recipes/say/words.yaml", "text: one two", "text: three")
    assert built.build("say/words:start").code == 0
    line, cause = built.dxb("why", "say/words:words").out.splitlines()[1:]
    assert line.startswith("  input\ttext\t")
    assert line.endswith("\tstart")
    assert cause == "    option\ttext\tone two -> three\trecipes/say/words.yaml:3:34"


def test_a_node_that_waits_shows_the_way_to_the_changed_function(built):
    built.edit("rules/toy/marks.py", 'b"!" * times', 'b"?" * times')
    answer = built.dxb("why", "say/words:all")
    head, *rows = answer.out.splitlines()
    assert head.startswith("may be stale, depending on its inputs; it was up to date in run 0001 (")
    assert rows == [
        "  waits for\tword[one].louder and 1 more copy\tdepends on its inputs\tinput `texts`",
        "    waits for\tword[one].loud\tstale\tinput `text`",
        rows[2],
    ]
    assert rows[2].startswith("      code\t`mark` of rules/toy/marks.py\t")
    assert rows[2].endswith("\trules/toy/marks.py:3")


def test_a_node_that_waits_shows_the_way_to_the_changed_file(notes):
    notes.write("notes/b.txt", "three")
    notes.write("notes/c.txt", "four")
    answer = notes.dxb("why", "--json", "say/notes:end")
    assert causes(answer) == [
        (0, "waits for", "all"),
        (1, "waits for", "words"),
        (2, "waits for", "text"),
        (3, "input", "notes"),
        (4, "file", "b.txt"),
        (4, "file", "c.txt"),
    ]
    rows = answer.document["causes"]
    assert (rows[2]["change"], rows[2]["place"]) == ("stale", "input `text`")
    assert rows[3]["place"] == "notes"
    assert rows[4]["place"] == "notes/b.txt"
    assert rows[5]["change"] == "added"


def test_what_was_built_meanwhile_is_followed_to_its_first_cause(notes):
    notes.write("notes/b.txt", "three")
    assert notes.build("say/notes:all").code == 0
    answer = notes.dxb("why", "--json", "say/notes:end")
    assert answer.document["answer"].startswith("stale: 1 thing it depends on changed since run 0001")
    # One word was left out and another came in, so `all` reads other copies: that comes from `words`.
    assert causes(answer) == [
        (0, "input", "text"),
        (1, "input", "texts"),
        (2, "input", "text"),
        (3, "input", "notes"),
        (4, "file", "b.txt"),
    ]
    assert answer.document["causes"][1]["change"].endswith("; new: word[three].loud; gone: word[two].loud")


def test_copies_that_changed_alike_stand_together(built):
    built.edit(
        "recipes/say/words.yaml",
        "loud: {rule: toy.shout, text: $word}",
        "loud: {rule: toy.shout, text: $word, times: 5}",
    )
    assert built.build("say/words:word.louder").code == 0
    answer = built.dxb("why", "say/words:all")
    rows = answer.out.splitlines()[1:]
    assert [row.split("\t")[:2] for row in rows] == [
        ["  input", "texts"],
        ["    input", "text"],
        ["      option", "times"],
    ]
    assert rows[2].endswith("\t1 -> 5\trecipes/say/words.yaml:9:51")


def test_copies_that_changed_each_in_its_way_are_named(built):
    assert built.build("say/words:word.louder", "--set", "word[one].loud.times=4").code == 0
    answer = built.dxb("why", "--json", "say/words:all", "--set", "word[one].loud.times=4")
    assert causes(answer) == [
        (0, "input", "texts"),
        (1, "input", "text"),
        (2, "option", "times"),
    ]
    both = ["--set", "word[one].louder.times=4", "--set", "word[two].louder.times=5"]
    assert built.build("say/words:word.louder", *both).code == 0
    answer = built.dxb("why", "--json", "say/words:all", *both)
    assert causes(answer) == [
        (0, "input", "texts"),
        (1, "node", "word[one].louder"),
        (2, "option", "times"),
        (1, "node", "word[two].louder"),
        (2, "option", "times"),
    ]


def test_an_input_that_comes_from_elsewhere_says_from_where(built):
    built.edit(
        "recipes/say/words.yaml", "nodes:\n  start:", "nodes:\n  other: {rule: toy.start, text: three}\n  start:"
    )
    built.edit("recipes/say/words.yaml", "split, text: $start", "split, text: $other")
    assert built.build("say/words:other").code == 0
    (line,) = built.dxb("why", "say/words:words").out.splitlines()[1:]
    assert line.startswith("  input\ttext\t")
    assert line.endswith("\tother")


def test_what_was_never_built_names_what_it_waits_for(space):
    answer = space.dxb("why", "--json", "say/words:all")
    assert answer.document["answer"] == "never built"
    assert causes(answer) == [
        (0, "waits for", "words"),
        (1, "waits for", "start"),
    ]


def test_a_lost_key_document_is_said(built):
    built.edit("recipes/say/words.yaml", "text: one two", "text: three")
    key = built.dxb("show", "--json", "say/words:start").document["key"]
    (built.root / "cache" / "cas" / key[:2] / key[2:]).unlink()
    answer = built.dxb("why", "say/words:start")
    assert answer.code == 0
    assert "  lost\tstart\tits key document of run 0001 is no longer in the store" in answer.out
