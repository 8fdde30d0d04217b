"""Everything that goes wrong: one clear error, the right exit code, the store intact, the next build goes on."""

from __future__ import annotations

import json
import os
import signal
import time

import pytest

RECIPE = """nodes:
  start: {rule: toy.start}
  bad: {rule: toy.slow, text: $start, do: %s}
  after: {rule: toy.shout, text: $bad, times: 3}
  other: {rule: toy.slow, text: $start, seconds: 0.3}
  beside: {rule: toy.shout, text: $other}
targets: {default: [after, beside]}
"""


GROUP = '''
"""toy.grp: two words."""
from dextera_build.artifacts.base import Collection, File
from dextera_build.rule import Context, rule

@rule(version=1)
def grp(ctx: Context) -> Collection[File]:
    """Two words."""
    return Collection[File](items={"a": File(data=b"one"), "b": File(data=b"two")})
'''
JOIN = '''
"""toy.join: joins words."""
from dextera_build.artifacts.base import Collection, File
from dextera_build.rule import Context, rule

@rule(version=1)
def join(ctx: Context, words: Collection[File]) -> File:
    """Return all words."""
    return File(data=b" ".join(word.data for word in words.items.values()))
'''
EACH = """nodes:
  words: {rule: toy.grp}
  word:
    each: $words
    as: word
    on_failure: go_on
    nodes:
      cut: {rule: toy.slow, text: $word}
    overrides:
      b: {cut: {do: fail}}
  joined: {rule: toy.join, words: $word.cut}
targets: {default: [joined]}
"""
PARTS = """nodes:
  one: {recipe: say/sound}
  two: {recipe: say/broken, on_failure: go_on}
  joined: {rule: toy.join, words: {one: $one.word, two: $two.word}}
targets: {default: [joined]}
"""


def test_a_failed_check_says_what_where_and_what_waits(space):
    space.write("recipes/say/bad.yaml", RECIPE % "fail")
    answer = space.dxb("build", "say/bad")
    assert answer.code == 1
    assert "error[DXB-B201]: bad failed its check: the text is wrong" in answer.err
    assert "length" in answer.err
    assert "after" in answer.err
    assert "bad\tfailed\t" in (log := space.dxb("log").out)
    assert "DXB-B201: the text is wrong" in log
    assert "hint: set `do` to `work`" in answer.err
    assert "Traceback" not in answer.err


def test_a_node_with_go_on_does_not_stop_the_others(space):
    space.write("recipes/say/bad.yaml", (RECIPE % "fail").replace("do: fail", "do: fail, on_failure: go_on"))
    answer = space.build("say/bad")
    assert answer.code == 1
    assert answer.nodes("ran") == {"start", "other", "beside"}
    assert answer.nodes("failed") == {"bad"}
    assert "beside" in answer.out, "what was built is placed"


def test_a_copy_with_go_on_is_missing_in_the_collection_and_told(space):
    space.write("rules/toy/grp.py", GROUP.lstrip())
    space.write("rules/toy/join.py", JOIN.lstrip())
    space.write("recipes/say/each.yaml", EACH)
    answer = space.build("say/each")
    assert answer.code == 1
    assert answer.nodes("failed") == {"word[b].cut"}
    assert "joined" in answer.nodes("ran")
    space.edit("recipes/say/each.yaml", "b: {cut: {do: fail}}", "b: {cut: {do: work}}")
    again = space.build("say/each")
    assert again.code == 0
    assert {"word[b].cut", "joined"} <= again.nodes("ran")


def test_a_recipe_with_go_on_is_missing_in_a_listed_collection_and_told(space):
    space.write("rules/toy/join.py", JOIN.lstrip())
    part = (
        "nodes: {start: {rule: toy.start}, word: {rule: toy.slow, text: $start, do: %s}}\ntargets: {default: [word]}\n"
    )
    space.write("recipes/say/sound.yaml", part % "work")
    space.write("recipes/say/broken.yaml", part % "fail")
    space.write("recipes/say/all.yaml", PARTS)
    answer = space.build("say/all")
    assert answer.code == 1
    assert answer.nodes("failed") == {"two/word"}
    assert "joined" in answer.nodes("ran")
    space.edit("recipes/say/broken.yaml", "do: fail", "do: work")
    again = space.build("say/all")
    assert again.code == 0
    assert "joined" in again.nodes("ran")


def test_keep_going_builds_what_does_not_depend_on_it(space):
    space.write("recipes/say/bad.yaml", RECIPE % "fail")
    answer = space.build("-k", "say/bad")
    assert answer.code == 1
    assert answer.nodes("ran") == {"start", "other", "beside"}
    assert answer.nodes("failed") == {"bad"}
    assert answer.nodes("waits") == {"after"}


@pytest.mark.parametrize(
    ("do", "code", "text", "last"),
    [
        ("kill", "B301", "signal 9", "printed kill"),
        ("raise", "B302", "ZeroDivisionError: by hand", "ZeroDivisionError: by hand"),
    ],
)
def test_a_dead_or_faulty_worker_fails_its_node_alone(space, do, code, text, last):
    space.write("recipes/say/bad.yaml", RECIPE % do)
    answer = space.dxb("build", "-k", "say/bad")
    assert answer.code == 1
    assert f"error[DXB-{code}]" in answer.err
    assert text in answer.err
    assert "Traceback" not in answer.err
    assert ("rules/toy/slow.py:" in answer.err) == (do == "raise")
    log = space.dxb("log", "say/bad", "bad").out.splitlines()
    assert (log[0], log[-1]) == (f"printed {do}", last)
    assert ("Traceback (most recent call last):" in log) == (do == "raise")
    space.edit("recipes/say/bad.yaml", f"do: {do}", "do: work")
    again = space.build("say/bad")
    assert again.code == 0
    assert again.nodes("ran") == {"bad", "after"}


@pytest.mark.medium
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_ctrl_c_keeps_what_is_done(space, number, code):
    space.write("recipes/say/bad.yaml", RECIPE.replace("seconds: 0.3", "seconds: 60") % "work")
    process = space.start("build", "-j", "1", "say/bad", start_new_session=True)
    runs = space.root / "cache" / "runs" / "0001" / "events.jsonl"
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and not (
        runs.exists() and '"node_started"' in runs.read_text() and '"other"' in runs.read_text()
    ):
        time.sleep(0.05)
    os.killpg(process.pid, number)
    _, err = process.communicate(timeout=40)
    assert process.returncode == code
    assert json.loads(runs.read_text().splitlines()[-1])["interrupted"]
    assert "interrupted; finished results are kept" in err
    assert "Traceback" not in err
    space.edit("recipes/say/bad.yaml", "seconds: 60", "seconds: 0")
    again = space.build("say/bad")
    assert again.code == 0
    assert "start" in again.nodes("cached")


def test_a_missing_file_is_named(space):
    space.write(
        "recipes/say/note.yaml", "inputs: {note: notes/gone.txt}\nnodes:\n  w: {rule: toy.split, text: $note}\n"
    )
    answer = space.dxb("build", "say/note")
    assert answer.code == 2
    assert "error[DXB-R301]: `notes/gone.txt` is neither a file nor a recipe" in answer.err
    assert "--> recipes/say/note.yaml:1:16" in answer.err
    assert "Traceback" not in answer.err


def test_check_looks_beyond_a_path_where_nothing_is(space):
    space.write(
        "recipes/say/note.yaml",
        "inputs: {note: notes/gone.txt}\n"
        "nodes: {w: {rule: toy.split, text: $note}, x: {rule: toy.split, text: $nothing}}\n",
    )
    answer = space.dxb("check", "say/note")
    assert (answer.code, "`$nothing` names nothing" in answer.err) == (2, True)
    space.edit("recipes/say/note.yaml", "$nothing", "$note")
    answer = space.dxb("check", "say/note")
    assert (answer.code, "error[DXB-R301]: `notes/gone.txt` is neither" in answer.err) == (2, True)
    space.edit("recipes/say/note.yaml", "notes/gone.txt", "note.txt")
    space.write("note.txt", "one")
    assert space.dxb("check", "say/note").code == 0


def test_an_unknown_recipe_lists_the_known(space):
    answer = space.dxb("build", "say/wrods")
    assert answer.code == 2
    assert "no recipe is called `say/wrods`" in answer.err
    assert "did you mean `say/words`?" in answer.err


def test_a_recipe_error_shows_the_line(space):
    space.write("recipes/say/wrong.yaml", "nodes:\n  a: {rule: toy.split, text: $b}\n")
    answer = space.dxb("build", "say/wrong")
    assert answer.code == 2
    assert "--> recipes/say/wrong.yaml:2:30" in answer.err
    assert "^^" in answer.err


def test_a_lost_blob_is_made_again(space):
    assert space.build("say/words").code == 0
    output = next(e["output"] for e in space.build("--force", "start", "say/words").events if e.get("node") == "words")
    blob = space.root / "cache" / "cas" / output[:2] / output[2:]
    blob.unlink()
    again = space.build("say/words")
    assert again.code == 0
    assert again.nodes("ran") == {"words"}


def test_a_damaged_blob_is_not_believed(space):
    assert space.build("say/words").code == 0
    (out,) = [line.partition("\t")[2] for line in space.dxb("build", "say/words").out.splitlines()]
    (space.root / out).unlink()
    for blob in (space.root / "cache" / "cas").rglob("*"):
        if blob.is_file() and blob.read_bytes() == b"ONE!!! TWO!!!":
            blob.chmod(0o644)
            blob.write_bytes(b"ONE!!! TWO???")
    assert space.build("say/words", "--force", "words").code == 0
    answer = space.dxb("build", "say/words", "--force", "start")
    assert (space.root / out).read_bytes() == b"ONE!!! TWO!!!", answer.err


@pytest.mark.parametrize("words", [["build"], ["build", "say/words", "--nope"], ["get", "say/words"], ["show"]])
def test_a_wrong_command_line_exits_with_two(space, words):
    answer = space.dxb(*words)
    assert answer.code == 2
    assert answer.err.startswith("error[DXB-U")
    assert "hint:" in answer.err
