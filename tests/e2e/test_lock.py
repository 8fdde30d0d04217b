"""`dxb.lock`: written by `--lock`, kept up to date, and what `--locked` refuses."""

from __future__ import annotations

import shutil

import pytest

from dextera_build.project import lockfile
from dextera_build.project.lockfile import Lock, Name
from dextera_build.store.store import Store

NOTE = "inputs: {note: note.txt}\nnodes:\n  w: {rule: toy.split, text: $note}\n"


def pins(space):
    return {str(name): pin for name, pin in (lockfile.read(space.root / "dxb.lock") or Lock()).pins.items()}


@pytest.fixture
def locked(space):
    answer = space.dxb("build", "--lock", "say/words")
    assert answer.code == 0
    assert "dxb.lock: 1 target pinned" in answer.err
    return space


def test_a_build_pins_nothing_unless_it_is_asked_to(space):
    assert space.build("say/words").code == 0
    assert not (space.root / "dxb.lock").exists()


def test_key_output_and_size_are_those_of_the_target(locked):
    (pin,) = pins(locked).values()
    store = Store(locked.root / "cache")
    found = store.actions.get(pin.key)
    assert found.output == pin.output
    header = store.blobs.get(pin.output)
    assert pin.size == len(header) + len(b"ONE!!! TWO!!!")


@pytest.mark.medium
def test_a_locked_build_of_the_same_is_done_also_by_an_empty_store(locked):
    assert locked.dxb("build", "--locked", "say/words").code == 0
    again = locked.dxb("build", "--locked", "say/words")
    assert again.code == 0
    assert "is up to date" in again.err
    shutil.rmtree(locked.root / "cache")
    assert locked.dxb("build", "--locked", "say/words").code == 0


@pytest.mark.medium
def test_the_file_is_not_written_where_nothing_changed(locked):
    before = (locked.root / "dxb.lock").stat()
    assert locked.dxb("build", "--lock", "say/words").code == 0
    after = (locked.root / "dxb.lock").stat()
    assert (before.st_mtime_ns, before.st_ino) == (after.st_mtime_ns, after.st_ino)


@pytest.mark.medium
def test_an_option_upstream_is_named_when_the_target_is_known_to_differ(locked):
    locked.edit("recipes/say/words.yaml", "text: one two", "text: three")
    answer = locked.dxb("build", "--locked", "say/words")
    assert answer.code == 3
    assert "error[DXB-C103]: `say/words` does not match `dxb.lock`" in answer.err
    assert "option  text  one two -> three  recipes/say/words.yaml:3:34" in answer.err
    assert "hint: `dxb build --lock say/words`" in answer.err
    assert answer.out == ""
    # Refused at once now, for its key is known.
    again = locked.build("--locked", "say/words")
    assert again.code == 3
    assert again.nodes("ran", "cached") == set()


@pytest.mark.medium
def test_code_is_named(locked):
    locked.edit("rules/toy/join.py", 'b" ".join', 'b"-".join')
    answer = locked.build("--locked", "say/words")
    assert answer.code == 3
    assert "code  `join` of rules/toy/join.py" in answer.err
    assert answer.nodes("ran") == set()


def test_a_file_is_named(space):
    space.write("note.txt", "one two")
    space.write("recipes/say/note.yaml", NOTE)
    assert space.dxb("build", "--lock", "say/note").code == 0
    space.write("note.txt", "one three")
    answer = space.dxb("build", "--locked", "say/note")
    assert answer.code == 3
    assert "input  text  " in answer.err
    assert "note.txt" in answer.err


def test_a_store_that_never_had_the_locked_build_says_so(locked):
    shutil.rmtree(locked.root / "cache")
    locked.edit("rules/toy/join.py", 'b" ".join', 'b"-".join')
    answer = locked.dxb("build", "--locked", "say/words")
    assert answer.code == 3
    assert "is not in the store" in answer.err


def test_another_output_under_the_same_key_is_refused(locked):
    (name,) = lockfile.read(locked.root / "dxb.lock").pins
    (pin,) = pins(locked).values()
    lockfile.write(locked.root / "dxb.lock", Lock({name: lockfile.Pin(pin.key, "0" * 64, pin.size)}))
    answer = locked.dxb("build", "--locked", "say/words")
    assert answer.code == 3
    assert f"key {pin.key[:12]} as pinned, output 000000000000 -> {pin.output[:12]}" in answer.err


def test_what_is_not_pinned_is_refused_before_anything_runs(locked):
    locked.edit("recipes/say/words.yaml", "text: one two", "text: three")
    answer = locked.build("--locked", "say/words:words")
    assert answer.code == 3
    assert "words   not pinned" in answer.err
    assert answer.nodes("ran", "cached") == set()


@pytest.mark.medium
def test_a_copy_that_is_gone_is_refused_and_loses_its_pin(space):
    assert space.dxb("build", "--lock", "say/words:word.loud").code == 0
    assert set(pins(space)) == {"say/words:word[one].loud", "say/words:word[two].loud"}
    space.edit("recipes/say/words.yaml", "text: one two", "text: one")
    answer = space.dxb("build", "--locked", "say/words:word.loud")
    assert answer.code == 3
    assert "word[two].loud   pinned, but not there any more" in answer.err
    answer = space.dxb("build", "say/words:word.loud")
    assert "dxb.lock: 1 pin dropped: say/words:word[two].loud" in answer.err
    assert set(pins(space)) == {"say/words:word[one].loud"}
    assert space.dxb("build", "--locked", "say/words:word.loud").code == 0


def test_pins_that_are_there_are_kept_up_to_date_and_none_is_added(locked):
    before = pins(locked)
    locked.edit("recipes/say/words.yaml", "text: one two", "text: three")
    answer = locked.dxb("build", "say/words", "say/words:words")
    assert "dxb.lock: 1 target pinned" in answer.err
    assert set(pins(locked)) == set(before)
    assert pins(locked) != before
    assert locked.dxb("build", "--locked", "say/words").code == 0


def test_a_failed_build_pins_nothing(locked):
    before = (locked.root / "dxb.lock").read_text()
    locked.write(
        "recipes/say/words.yaml",
        "nodes:\n  all: {rule: toy.start, text: x}\n  b: {rule: toy.slow, text: $all, do: fail}\n",
    )
    assert locked.dxb("build", "--lock", "-k", "say/words").code == 1
    assert (locked.root / "dxb.lock").read_text() == before


def test_pins_of_recipes_that_are_gone_are_dropped_with_a_notice(locked):
    locked.write("recipes/say/other.yaml", "nodes: {a: {rule: toy.start}}\n")
    (locked.root / "recipes/say/words.yaml").rename(locked.root / "words.yaml")
    assert locked.dxb("build", "say/other").code == 0
    assert set(pins(locked)) == {"say/words:all"}
    answer = locked.dxb("build", "--lock", "say/other")
    assert "1 pin dropped: say/words:all" in answer.err
    assert set(pins(locked)) == {"say/other:a"}


@pytest.mark.medium
def test_profiles_have_pins_of_their_own(locked):
    assert locked.dxb("build", "--locked", "--profile", "stub", "say/words").code == 3
    assert locked.dxb("build", "--lock", "--profile", "stub", "say/words").code == 0
    assert {name.profile for name in lockfile.read(locked.root / "dxb.lock").pins} == {"cpu", "stub"}
    assert Name("cpu", "say/words", "all") in lockfile.read(locked.root / "dxb.lock").pins


def test_what_is_added_to_a_recipe_is_not_pinned(locked):
    before = (locked.root / "dxb.lock").read_text()
    assert locked.dxb("build", "say/words", "--set", "start.text=four").code == 0
    assert (locked.root / "dxb.lock").read_text() == before
    for flag in ("--lock", "--locked"):
        answer = locked.dxb("build", flag, "say/words", "--set", "start.text=four")
        assert answer.code == 2
        assert "DXB-U161" in answer.err
    answer = locked.dxb("build", "--lock", "--locked", "say/words")
    assert (answer.code, "DXB-U160" in answer.err) == (2, True)


@pytest.mark.medium
def test_a_build_of_given_inputs_is_pinned_with_lock_alone(space):
    space.write(
        "recipes/say/note.yaml", "inputs: {note: {help: a text}}\nnodes:\n  w: {rule: toy.split, text: $note}\n"
    )
    for name, text in (("a.txt", "one two"), ("same.txt", "one two"), ("b.txt", "three")):
        space.write(name, text)
    assert space.dxb("build", "--lock", "say/note", "--input", "note=a.txt").code == 0
    before = pins(space)
    assert len(before) == 1
    assert space.dxb("build", "say/note", "--input", "note=b.txt").code == 0
    assert pins(space) == before, "a build on the side"
    assert space.dxb("build", "--locked", "say/note", "--input", "note=same.txt").code == 0
    answer = space.dxb("build", "--locked", "say/note", "--input", "note=b.txt")
    assert (answer.code, "does not match `dxb.lock`" in answer.err) == (3, True)
    assert "dxb build --lock say/note --input note=b.txt" in answer.err
    assert space.dxb("build", "--lock", "say/note", "--input", "note=b.txt").code == 0
    assert pins(space) != before


@pytest.mark.medium
def test_a_merge_conflict_stops_the_build_and_is_left_as_it_is(locked):
    path = locked.root / "dxb.lock"
    path.write_text("<<<<<<< ours\n" + path.read_text())
    answer = locked.dxb("build", "say/words")
    assert answer.code == 2
    assert "error[DXB-R502]: the lock file holds a merge conflict" in answer.err
    assert "dxb.lock:1" in answer.err
    assert path.read_text().startswith("<<<<<<<")
