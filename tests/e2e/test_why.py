"""`dxb why` names each cause with its file and line."""

from __future__ import annotations

import json

import pytest


@pytest.fixture
def built(space):
    assert space.build("say/words").code == 0
    return space


def test_up_to_date(built):
    answer = built.dxb("why", "say/words:word[one].loud")
    assert answer.out.startswith("up to date: key ")
    assert "built by run 0001" in answer.out


def test_never_built(space):
    assert space.dxb("why", "say/words:start").out.startswith("never built")


def test_an_option_is_named_with_its_line(built):
    built.edit("recipes/say/words.yaml", "text: one two", "text: three")
    answer = built.dxb("why", "say/words:start")
    assert answer.out.splitlines()[0].startswith("stale: 1 things it depends on changed since run 0001")
    assert answer.out.splitlines()[1] == "  option\ttext\tone two -> three\trecipes/say/words.yaml:3:34"


def test_a_changed_helper_is_named_with_function_and_line(built):
    built.edit("rules/toy/marks.py", 'b"!" * times', 'b"?" * times')
    answer = json.loads(built.dxb("why", "--json", "say/words:word[two].loud").out)
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


def test_an_unknown_node_lists_the_known(built):
    answer = built.dxb("why", "say/words:strat")
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
    assert "is not known yet: its group is not open" in never.err


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
    (line,) = built.dxb("why", "say/words:words").out.splitlines()[1:]
    assert line.startswith("  input\ttext\t")
    assert line.endswith("\tstart")
