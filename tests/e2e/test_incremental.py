"""What is rebuilt after which change: exact sets of nodes, through the real `dxb`."""

from __future__ import annotations

import os

import pytest

EVERY = {"start", "words", "all", *(f"word[{w}].{n}" for w in ("one", "two") for n in ("loud", "louder"))}


@pytest.fixture
def built(space):
    first = space.build("say/words")
    assert first.code == 0, first.err
    assert first.nodes("ran") == EVERY
    return space


def test_the_second_build_runs_nothing_and_plans_nothing(built):
    built.dxb("build", "say/words")  # a snapshot answers the command line that it was made for
    runs = len(list((built.root / "cache/runs").iterdir()))
    again = built.dxb("build", "say/words")
    assert again.code == 0
    assert again.err.startswith("say/words is up to date   7 nodes")
    assert (built.root / again.out.strip().partition("\t")[2]).read_bytes() == b"ONE!!! TWO!!!"
    assert len(list((built.root / "cache/runs").iterdir())) == runs


def test_touching_a_recipe_runs_nothing(built):
    (built.root / "recipes/say/words.yaml").touch()
    again = built.build("say/words")
    assert again.nodes("ran") == set()
    assert again.nodes("cached") == EVERY


def test_an_option_of_one_copy_rebuilds_its_chain(built):
    again = built.build("say/words", "--set", "word[one].loud.times=4")
    assert again.nodes("ran") == {"word[one].loud", "word[one].louder", "all"}


def test_the_same_text_by_another_way_stops_early(built):
    # The sentence changes, the words do not: `words` runs and its readers stay.
    built.edit("recipes/say/words.yaml", "text: one two", "text: 'one  two'")
    assert built.build("say/words").nodes("ran") == {"start", "words"}


@pytest.mark.medium
def test_a_renamed_item_rebuilds_nothing_of_the_item(built):
    built.edit("rules/toy/split.py", "word.decode(): File", "'the_' + word.decode(): File")
    again = built.build("say/words")
    assert again.nodes("ran") == {"words", "all"}
    assert again.nodes("cached") >= {"word[the_one].loud", "word[the_two].louder"}


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("rules/toy/shout.py", "    return File(", "    # loudly\n    return File("),
        ("rules/toy/shout.py", '"""Return the text in capitals."""', '"""Return capitals."""'),
        ("rules/toy/shout.py", '"""How many marks."""', '"""Number of marks."""'),
        ("rules/toy/marks.py", '"""Exclamation marks."""', '"""Marks of exclamation."""'),
    ],
)
def test_comments_and_docstrings_rebuild_nothing(built, file, old, new):
    built.edit(file, old, new)
    again = built.build("say/words")
    assert again.code == 0
    assert again.nodes("ran") == set()


def test_a_changed_helper_rebuilds_the_rules_that_import_it(built):
    built.edit("rules/toy/marks.py", 'b"!" * times', 'b"?" * times')
    assert built.build("say/words").nodes("ran") == EVERY - {"start", "words"}


@pytest.mark.medium
def test_a_helper_that_changes_no_bytes_stops_at_once(built):
    built.edit("rules/toy/marks.py", 'b"!" * times', 'b"".join([b"!"] * times)')
    # `loud` gives equal bytes; `louder` runs because its own code changed too, then `all` stays.
    assert built.build("say/words").nodes("ran") == EVERY - {"start", "words", "all"}


@pytest.mark.medium
def test_a_file_is_an_input_by_content(space):
    space.write("note.txt", "one two")
    space.write("recipes/say/note.yaml", "inputs: {note: note.txt}\nnodes:\n  w: {rule: toy.split, text: $note}\n")
    assert space.build("say/note").nodes("ran") == {"w"}
    (space.root / "note.txt").touch()
    assert space.build("say/note").nodes("ran") == set()
    space.write("note.txt", "one three")
    assert space.build("say/note").nodes("ran") == {"w"}
    space.write("note.txt", "one two")
    assert space.build("say/note").nodes("cached") == {"w"}


@pytest.mark.medium
def test_a_deleted_output_file_is_written_again(built):
    out = built.root / built.dxb("build", "say/words").out.strip().partition("\t")[2]
    out.unlink()
    again = built.build("say/words")
    assert again.nodes("ran") == set()
    assert out.read_bytes() == b"ONE!!! TWO!!!"


@pytest.mark.slow
def test_an_output_file_that_was_changed_is_written_again_and_the_change_is_kept(built):
    out = built.root / built.dxb("build", "say/words").out.strip().partition("\t")[2]
    for aside in ("all~", "all~2"):
        out.write_bytes(b"mine")
        again = built.dxb("build", "say/words")
        assert out.read_bytes() == b"ONE!!! TWO!!!"
        kept = f"cache/out/say/words/{aside}"
        assert (
            f"files of `all` in out/ were edited; they are restored, and the edited ones are kept in {kept}\n"
            in again.err
        )
        assert (built.root / kept / "all").read_bytes() == b"mine"
    out.write_bytes(b"mine, too")
    built.edit("recipes/say/words.yaml", "one two", "one four")
    built.dxb("build", "say/words")
    assert out.read_bytes() == b"FOUR!!! ONE!!!"
    assert (built.root / "cache/out/say/words/all~3/all").read_bytes() == b"mine, too"


@pytest.mark.medium
def test_a_new_time_alone_is_no_change_of_an_output_file(built):
    out = built.root / built.dxb("build", "say/words").out.strip().partition("\t")[2]
    os.utime(out, (1, 1))
    assert "were changed" not in built.dxb("build", "say/words").err
    assert out.read_bytes() == b"ONE!!! TWO!!!"
    assert not out.parent.with_name("all~").exists()
    os.utime(out, (1, 1))
    built.edit("recipes/say/words.yaml", "one two", "one four")
    assert "were changed" not in built.dxb("build", "say/words").err
    assert out.read_bytes() == b"FOUR!!! ONE!!!"
    assert not out.parent.with_name("all~").exists()


@pytest.mark.medium
def test_force_runs_one_node(built):
    assert built.build("say/words", "--force", "word[one].loud").nodes("ran") == {"word[one].loud"}


@pytest.mark.medium
def test_check_says_stale_with_its_own_code(built):
    assert built.dxb("build", "--check", "say/words").code == 0
    built.edit("recipes/say/words.yaml", "one two", "one three")
    answer = built.dxb("build", "--check", "say/words")
    assert answer.code == 3
    assert "`say/words` is stale" in answer.err
    assert "hint: `dxb why 'say/words:start'`" in answer.err


@pytest.mark.medium
def test_a_build_that_runs_nothing_keeps_to_its_console(built):
    again = built.build("say/words")
    event = again.events[-1]
    assert (event["event"], event["counts"]) == ("run_finished", {"cached": 7})
    assert built.dxb("build", "--console", "none", "say/words").err == ""


@pytest.mark.medium
@pytest.mark.parametrize("verb", ["plan", "build"])
def test_a_check_says_in_a_line_each_what_is_stale_and_why(built, verb):
    assert built.dxb(verb, "--check", "say/words").code == 0
    built.edit("rules/toy/marks.py", 'b"!" * times', 'b"?" * times')
    built.edit("recipes/say/words.yaml", "  start:", "  more: {rule: toy.start}\n  start:")
    built.edit("recipes/say/words.yaml", "[all]", "[all, more]")
    answer = built.dxb(verb, "--check", "say/words")
    assert answer.code == 3
    rows = dict(line.split("\t") for line in answer.out.splitlines())
    assert rows["more"] == "never built"
    assert rows["word[one].loud"].startswith("code `mark` of rules/toy/marks.py ")
    assert set(rows) == {"more", "word[one].loud", "word[two].loud"}
    assert "error[DXB-C102]: `say/words` is stale" in answer.err
    assert "stale        3 nodes" in answer.err
    assert "may follow   3 nodes" in answer.err


@pytest.mark.slow
def test_a_check_counts_further_changes_and_tells_what_was_lost(built):
    built.edit("recipes/say/words.yaml", "text: one two}", "text: three, sizes_m: [2.0]}")
    (row,) = built.dxb("plan", "--check", "--json", "say/words").rows
    assert row["node"] == "start"
    assert row["why"].startswith("option sizes_m [1.0] -> [2.0] recipes/say/words.yaml:3:50, and 1 more")
    built.edit("recipes/say/words.yaml", "text: three, sizes_m: [2.0]}", "text: one two}")
    for file in (built.root / "cache/ac").rglob("*"):
        if file.is_file():
            file.unlink()
    (row,) = built.dxb("plan", "--check", "--json", "say/words").rows
    assert row["why"] == "built, but the store no longer holds it"
