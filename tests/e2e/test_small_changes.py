"""Small changes between two builds, through the real `dxb`: what runs, and what the log says of it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dextera_build.building.export import TABLE
from tests.e2e.space import Answer, Space

RECIPE = """
inputs:
  one: one.txt
  two: two.txt
  box: box
nodes:
  a: {rule: toy.slow, text: $one}
  b: {rule: toy.slow, text: $two}
  c: {rule: toy.join, one: $a, two: $b}
  d: {rule: toy.first, box: $box}
targets:
  default: [c, d]
"""
JOIN = '''
"""toy.join: two texts."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, rule

@rule(version=1)
def join(ctx: Context, one: File, two: File) -> File:
    """Return one text after the other."""
    return File(data=one.data + two.data)
'''
FIRST = '''
"""toy.first: a folder's names."""
from dextera_build.artifacts.base import File, Folder
from dextera_build.rule import Context, rule

@rule(version=1)
def first(ctx: Context, box: Folder) -> File:
    """Return the names."""
    return File(data=" ".join(sorted(box.files)).encode())
'''


@pytest.fixture
def built(space: Space) -> Space:
    space.write("recipes/two.yaml", RECIPE)
    space.write("rules/toy/join.py", JOIN.lstrip())
    space.write("rules/toy/first.py", FIRST.lstrip())
    for name in ("one.txt", "two.txt", "box/x"):
        space.write(name, name)
    time.sleep(0.05)
    assert space.dxb("build", "two").code == 0
    return space


def build(space: Space, *words: str, **env: str) -> tuple[Answer, dict[str, str] | None]:
    """The answer, and how each node ended if there was a run."""
    before = runs(space)
    answer = space.dxb("build", "two", "--console", "none", *words, env=env)
    assert answer.code == 0, answer.err
    return answer, statuses(space) if runs(space) != before else None


def runs(space: Space) -> list[str]:
    return sorted(path.name for path in (space.root / "cache" / "runs").iterdir())


def statuses(space: Space) -> dict[str, str]:
    from dextera_build.runs import log
    from dextera_build.store.store import Store

    store = Store(space.root / "cache")
    events = log.read(store, log.runs(store)[-1])
    return {event["node"]: event["status"] for event in events if event["event"] == "node_finished"}


def output(space: Space, node: str) -> str:
    return (space.root / "cache" / "out" / "two" / node / node).read_text()


@pytest.mark.medium
def test_a_changed_file_runs_what_stands_above_it(built: Space) -> None:
    built.write("two.txt", "new")
    time.sleep(0.05)
    _, ended = build(built)
    assert ended == {"a": "cached", "b": "ran", "c": "ran", "d": "cached"}
    assert output(built, "c") == "one.txtnew"
    assert build(built)[1] is None
    built.write("one.txt", "also ")
    time.sleep(0.05)
    _, ended = build(built)
    assert ended == {"a": "ran", "b": "cached", "c": "ran", "d": "cached"}
    assert output(built, "c") == "also new"
    # A build that looks at everything finds nothing to do.
    assert set(built.build("two", "--force", "d").nodes("ran")) == {"d"}


def test_a_touched_file_runs_nothing(built: Space) -> None:
    (built.root / "two.txt").touch()
    time.sleep(0.05)
    looked, ended = build(built)
    assert set((ended or {}).values()) == {"cached"}
    assert looked.out.split() == ["c", "cache/out/two/c/c", "d", "cache/out/two/d/d"]
    assert build(built)[1] is None


def test_a_file_that_comes_into_a_folder_counts(built: Space) -> None:
    built.write("box/y", "y")
    time.sleep(0.05)
    _, ended = build(built)
    assert ended == {"a": "cached", "b": "cached", "c": "cached", "d": "ran"}
    assert output(built, "d") == "x y"
    (built.root / "box" / "x").unlink()
    time.sleep(0.05)
    build(built)
    assert output(built, "d") == "y"
    assert build(built)[1] is None


def test_a_deleted_output_is_written_again(built: Space) -> None:
    (built.root / "cache/out/two/c/c").unlink()
    assert set((build(built)[1] or {}).values()) == {"cached"}
    assert output(built, "c") == "one.txttwo.txt"


@pytest.mark.medium
@pytest.mark.parametrize("change", ["recipe", "rule", "configuration", "package", "new rule", "blob"])
def test_any_other_change_is_seen(built: Space, change: str, tmp_path: Path) -> None:
    env = {}
    if change == "package":
        built.write("lib/thing/__init__.py", "")
        env = {
            "PYTHONPATH": os.pathsep.join([str(tmp_path / "lib"), *os.environ.get("PYTHONPATH", "").split(os.pathsep)])
        }
        build(built, **env)
        assert build(built, **env)[1] is None
        (tmp_path / "lib/thing/__init__.py").unlink()
        (tmp_path / "lib/thing").rmdir()
    elif change == "recipe":
        built.edit("recipes/two.yaml", "targets:", "  e: {rule: toy.slow, text: $one}\ntargets:")
    elif change == "rule":
        built.edit("rules/toy/join.py", "one.data + two.data", "two.data + one.data")
    elif change == "configuration":
        built.write("dxb.toml", '# a comment\ncache = "cache"\n')
    elif change == "new rule":
        built.write("rules/toy/other.py", "")
    else:
        for path in (built.root / "cache" / "cas").glob("*/*"):
            path.unlink()
    time.sleep(0.05)
    _, ended = build(built, **env)
    assert ended is not None
    assert output(built, "c") == ("two.txtone.txt" if change == "rule" else "one.txttwo.txt")


def test_a_file_that_vanished_is_said(built: Space) -> None:
    (built.root / "two.txt").unlink()
    answer = built.dxb("build", "two")
    assert answer.code == 2
    assert "`two.txt` is neither a file nor a recipe" in answer.err


def test_a_failure_can_be_mended(built: Space) -> None:
    built.edit("recipes/two.yaml", "{rule: toy.slow, text: $two}", "{rule: toy.slow, text: $two, do: fail}")
    time.sleep(0.05)
    assert built.dxb("build", "two").code == 1
    built.edit("recipes/two.yaml", ", do: fail", "")
    time.sleep(0.05)
    assert set((build(built)[1] or {}).values()) == {"cached"}
    assert output(built, "c") == "one.txttwo.txt"


def test_a_target_above_no_change_is_written_again_where_its_file_is_gone(built: Space) -> None:
    (built.root / "cache" / "out" / "two" / "d" / "d").unlink()
    built.write("two.txt", "TWO.TXT")
    time.sleep(0.05)
    answer, ended = build(built)
    assert ended == {"a": "cached", "b": "ran", "c": "ran", "d": "cached"}
    assert [line.partition("\t")[0] for line in answer.out.splitlines()] == ["c", "d"]
    assert output(built, "d") == "x"
    assert output(built, "c") == "one.txtTWO.TXT"


HEAVY = ("numpy", "pydantic", "yaml", "rich", "dextera_build.recipe", "dextera_build.rule", "dextera_build.code.loader")
LOADED = """
import sys
from dextera_build.cli.main import main
assert main(sys.argv[1:]) == 0
print("loaded", *[name for name in {names} if name in sys.modules])
"""


@pytest.mark.medium
def test_a_build_that_does_nothing_loads_little(built: Space) -> None:
    words = [sys.executable, "-c", LOADED.format(names=HEAVY), "build", "two", "--console", "none"]
    for _ in range(2):  # the module search path differs from that of the fixture's build
        done = subprocess.run(words, cwd=built.root, env=built.environment(), text=True, capture_output=True)
        assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "loaded"


@pytest.mark.parametrize("file", ["recipes/two.yaml", "rules/toy/join.py", "rules/toy/slow.py"])
def test_a_comment_changes_nothing(built: Space, file: str) -> None:
    path = built.root / file
    path.write_text(path.read_text() + "\n\n# a comment\n")
    time.sleep(0.05)
    assert set((build(built)[1] or {}).values()) == {"cached"}
    assert build(built)[1] is None
    built.write("two.txt", "new")
    path.write_text(path.read_text() + "# another\n")
    time.sleep(0.05)
    _, ended = build(built)
    assert ended == {"a": "cached", "b": "ran", "c": "ran", "d": "cached"}


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("recipes/two.yaml", "one: $a, two: $b", "one: $b, two: $a"),
        ("recipes/two.yaml", "text: $two", "text: $two, seconds: 0.5"),
        ("recipes/two.yaml", "default: [c, d]", "default: [c]"),
        ("rules/toy/join.py", "version=1", "version=2"),
        ("rules/toy/join.py", "import Context, rule", "import Context, rule\nimport json"),
    ],
)
def test_what_says_something_else_is_seen(built: Space, file: str, old: str, new: str) -> None:
    built.edit(file, old, new)
    time.sleep(0.05)
    build(built)
    assert len(runs(built)) == 2


@pytest.mark.slow
def test_broken_local_state_is_passed_over(built: Space) -> None:
    file = built.root / "cache/local/state.db"
    built.write("two.txt", "new")
    time.sleep(0.05)
    for text in (b"", b"{}", file.read_bytes()[:-3], None):
        file.unlink()
        if text is not None:
            file.write_bytes(text)
        answer = built.dxb("build", "two")
        assert answer.code == 0, answer.err
        assert output(built, "c") == "one.txtnew"
        built.write("two.txt", "again")
        time.sleep(0.05)
        assert built.dxb("build", "two").code == 0
        assert output(built, "c") == "one.txtagain"
        built.write("two.txt", "new")
        time.sleep(0.05)


@pytest.mark.slow
def test_a_build_after_a_change_renews_the_pins_and_a_locked_one_looks_at_everything(built: Space) -> None:
    assert build(built, "--lock")[1] is not None
    pinned = (built.root / "dxb.lock").read_bytes()
    assert build(built)[1] is not None  # another request than the first: there is a lock file now
    built.write("two.txt", "new")
    time.sleep(0.05)
    _, ended = build(built)
    assert ended == {"a": "cached", "b": "ran", "c": "ran", "d": "cached"}
    renewed = (built.root / "dxb.lock").read_bytes()
    assert renewed != pinned
    assert set((build(built)[1] or {}).values()) == {"cached"}  # the pins changed after they were read
    # On a busy machine a file may still be too young to be trusted by its time.
    assert any(build(built)[1] is None for _ in range(3))
    assert built.dxb("build", "two", "--locked").code == 0
    built.write("two.txt", "more")
    time.sleep(0.05)
    refused = built.dxb("build", "two", "--locked")
    assert (refused.code, "DXB-C103" in refused.err) == (3, True)
    assert (built.root / "dxb.lock").read_bytes() == renewed
    built.edit("recipes/two.yaml", "nodes:", "# a comment\nnodes:")
    assert (built.dxb("build", "two", "--locked")).code == 3


@pytest.mark.medium
def test_a_rule_edited_twice_in_a_second_to_the_same_size_runs_as_it_is(built: Space) -> None:
    rule, moment = built.root / "rules/toy/first.py", int(time.time()) + 60  # young however slow this machine is
    for joint in ('"."', '"+"', '"-"'):
        built.write("rules/toy/first.py", FIRST.lstrip().replace('" "', joint))
        built.write("box/y", "y")
        os.utime(rule, (moment, moment))
        assert built.dxb("build", "two", env={"PYTHONDONTWRITEBYTECODE": ""}).code == 0
        assert output(built, "d") == f"x{joint[1]}y"


EMPTY = '''
"""toy.empty: a folder without files."""
from dextera_build.artifacts.base import File, Folder
from dextera_build.rule import Context, rule

@rule(version=1)
def empty(ctx: Context, text: File) -> Folder:
    """Return nothing, or one large file."""
    return Folder(files={}) if text.data == b"one.txt" else Folder(files={"a/b": text.data})
'''


@pytest.mark.slow
def test_code_edited_while_a_build_repeats_a_plan_waits_for_the_next_build(built: Space) -> None:
    built.write("recipes/wait.yaml", "inputs: {one: one.txt}\nnodes:\n  a: {rule: toy.slow, text: $one, seconds: 1}\n")
    built.edit("recipes/wait.yaml", "seconds: 1}\n", "seconds: 1}\n  c: {rule: toy.join, one: $a, two: $a}\n")
    time.sleep(0.05)
    assert built.dxb("plan", "wait").code == 0  # keeps its plan
    running = built.start("build", "wait", "--console", "jsonl", "-j", "1")
    assert running.stderr is not None
    while '"node_started"' not in (line := running.stderr.readline()) and line:
        pass
    built.edit("rules/toy/join.py", "one.data + two.data", "two.data + one.data + two.data")
    _, told = running.communicate()
    assert running.returncode == 0, told
    assert built.build("wait").nodes("ran") == {"c"}


@pytest.mark.medium
def test_outputs_come_back_as_they_were(built: Space) -> None:
    built.write("rules/toy/empty.py", EMPTY.lstrip())
    built.write("one.txt", "one.txt")
    built.write("two.txt", "x" * (1 << 20) + "y")
    more = "  e: {rule: toy.empty, text: $one}\n  f: {rule: toy.empty, text: $two}\ntargets:"
    built.write("recipes/two.yaml", RECIPE.replace("targets:", more).replace("[c, d]", "[c, d, e, f]"))
    time.sleep(0.05)
    first = built.dxb("build", "two")
    placed = tree(built)
    assert [line.partition("\t")[2] for line in first.out.splitlines()][2:] == [
        "cache/out/two/e",
        "cache/out/two/f/a/b",
    ]
    for missing in ("out", "out/two/c", "out/two/f/a/b", "out/two/.placed"):
        path = built.root / "cache" / missing
        shutil.rmtree(path) if path.is_dir() else path.unlink()
        assert built.dxb("build", "two").out == first.out
        assert tree(built) == placed


def tree(space: Space) -> dict[str, bytes]:
    folder = space.root / "cache" / "out"
    found = (path for path in folder.rglob("*") if path.is_file() and path.name != TABLE)
    return {str(path.relative_to(folder)): path.read_bytes() for path in found}
