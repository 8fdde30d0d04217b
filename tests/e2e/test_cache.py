"""`dxb cache`: size, collection and verification through the real program."""

from __future__ import annotations

import os
import shutil
import time
from pathlib import Path

import pytest

from dextera_build.store.state import State
from tests.e2e.space import Space


def results(space: Space) -> int:
    return int(space.dxb("cache", "size").out.splitlines()[1].split("\t")[1])


def grow_old(space: Space) -> None:
    """As if the store had not been used for a week."""
    then = time.time() - 7 * 86400
    for path in (space.root / "cache").rglob("*"):
        if path.is_file():
            os.utime(path, (then, then))


@pytest.fixture
def built(space: Space) -> Space:
    """Two variants, of which the first is nobody's any more."""
    recipe = (space.root / "recipes/say/words.yaml").read_text()
    space.write("recipes/say/words.yaml", recipe.replace("one two", "old"))
    assert space.dxb("build", "say/words").code == 0
    space.write("recipes/say/words.yaml", recipe)
    assert space.dxb("build", "say/words").code == 0
    grow_old(space)
    return space


def test_gc_is_dry_unless_told(built: Space) -> None:
    before = results(built)
    said = built.dxb("cache", "gc", "--max-size", "1B")
    assert said.code == 0
    assert "nothing was deleted: add `--yes`" in said.err
    assert results(built) == before


def test_gc_keeps_what_the_workspace_built_last(built: Space) -> None:
    before = results(built)
    said = built.dxb("cache", "gc", "--max-size", "1B", "--yes")
    assert said.code == 0
    rows = [line.split("\t") for line in said.out.splitlines()]
    assert {row[0] for row in rows} == {"drop", "keep"}
    assert [row[4] for row in rows if row[:2] == ["keep", "results"]] == [f"built last by {built.root}"]
    assert "that is above 1 B: the lines `keep` give the reasons" in said.err
    assert 0 < results(built) < before
    again = built.build("say/words")
    assert (again.code, again.nodes("ran")) == (0, set())
    assert built.dxb("cache", "verify").code == 0
    assert "drop" not in built.dxb("cache", "gc", "--max-size", "1B").out


def test_gc_by_age_and_as_json(built: Space) -> None:
    said = built.dxb("cache", "gc", "--max-age", "3d", "--yes", "--json").document
    assert said["after"] < said["before"]
    assert {row["kind"] for row in said["gone"]} >= {"results", "blobs"}
    assert said["dry"] is False
    assert said["vanished"] == []


def test_what_a_lock_file_names_stays(built: Space) -> None:
    keys = [path.parent.name + path.name for path in (built.root / "cache" / "ac").glob("??/*")]
    built.write("dxb.lock", "".join(f'"{number}" = "{key}"\n' for number, key in enumerate(keys)))
    before = results(built)
    assert built.dxb("cache", "gc", "--max-size", "1B", "--yes").code == 0
    assert results(built) == before


@pytest.mark.parametrize("name", ["\ud800", "a\nb", "\x1b[2J"])
def test_a_damaged_name_of_a_project_stays_in_its_line(built: Space, name: str) -> None:
    state = State(str(built.root / "cache" / "local" / "state.db"))
    for kind in state.kinds():
        if kind.startswith("history"):
            parts = kind.split("\0")
            state.put("\0".join((parts[0], name, *parts[2:])), state.all(kind))
    said = built.dxb("cache", "gc")
    assert said.code == 0, said.err
    rows = [line.split("\t") for line in said.out.split("\n")[:-1]]
    assert {len(row) for row in rows} == {5}
    assert all(cell.isprintable() for row in rows for cell in row)
    assert any(cell.startswith("built last by ") for row in rows for cell in row)


def test_a_workspace_that_vanished_holds_nothing_and_that_is_said(built: Space, tmp_path: Path) -> None:
    store = tmp_path / "elsewhere"
    shutil.move(built.root / "cache", store)
    other = Space(tmp_path / "other")
    other.write("dxb.toml", f'cache = "{store}"\n')
    said = other.dxb("cache", "gc", "--max-size", "1B")
    assert "is not there any more" not in said.err
    moved = tmp_path / "moved"
    state = State(str(store / "local" / "state.db"))
    for kind in state.kinds():
        rows = state.all(kind)
        state.put(kind.replace(str(built.root), str(moved)), rows)
        state.put(kind, {}, without=rows if str(built.root) in kind else ())
    said = other.dxb("cache", "gc", "--max-size", "1B", "--yes")
    assert f"`{moved}` no longer exists: its results are not kept" in said.err
    assert other.dxb("cache", "size").out.splitlines()[1] == "actions\t0\t0"


@pytest.mark.parametrize("text", ["50", "GB", "5 parsecs", "-1GB"])
def test_a_size_that_is_none_is_refused(space: Space, text: str) -> None:
    answer = space.dxb("cache", "gc", f"--max-size={text}")
    assert answer.code == 2
    assert f"error[DXB-U150]: `{text}` is not a size" in answer.err
    assert "write it as `50GB`" in answer.err
    answer = space.dxb("cache", "gc", f"--max-age={text}")
    assert f"error[DXB-U150]: `{text}` is not a time" in answer.err


def test_verify_exits_with_1_until_the_damage_is_repaired(built: Space) -> None:
    blob = max((built.root / "cache" / "cas").glob("??/*"), key=lambda path: path.stat().st_size)
    blob.chmod(0o644)
    blob.write_bytes(bytes(blob.stat().st_size))
    blob.chmod(0o444)
    name = blob.parent.name + blob.name
    found = built.dxb("cache", "verify")
    assert (found.code, found.out) == (1, f"damaged\t{name}\tits bytes do not match its digest\t-\n")
    assert "`dxb cache verify --repair` quarantines damaged files" in found.err
    assert built.dxb("cache", "verify", "--fast").code == 0
    repaired = built.dxb("cache", "verify", "--repair")
    assert repaired.code == 0
    assert repaired.out.startswith(f"damaged\t{name}\tits bytes do not match its digest\trepaired\n")
    again = built.dxb("cache", "verify", "--json")
    assert again.document["findings"] == []
    first = built.dxb("build", "say/words")
    assert first.code == 0


def test_old_logs_go_and_those_of_what_is_held_stay(built: Space) -> None:
    runs = built.root / "cache" / "runs"
    (real,) = {path.name for path in runs.iterdir()} & {"0001"}
    for number in range(100, 130):
        (runs / f"{number:04d}").mkdir()
        (runs / f"{number:04d}" / "events.jsonl").write_text("")
    then = time.time() - 100 * 86400
    for path in runs.rglob("*"):
        os.utime(path, (then, then))
    assert built.dxb("cache", "gc", "--yes").code == 0
    left = {path.name for path in runs.iterdir()}
    assert len([name for name in left if name >= "0100"]) == 20
    assert real in left
