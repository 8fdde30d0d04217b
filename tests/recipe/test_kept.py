"""Plans that earlier commands kept: when they are given again, and when everything is planned anew."""

from __future__ import annotations

import os
import shutil
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from dextera_build.engine.plan_json import read, write
from dextera_build.errors import UsageError
from dextera_build.project.planning import Added
from dextera_build.project.project import Project
from dextera_build.recipe import kept
from dextera_build.recipe.kept import Kept
from dextera_build.session import Session, warnings
from dextera_build.store.signature import Watch
from dextera_build.store.state import State
from dextera_build.store.store import Store
from tests.recipe.conftest import Space

READS = """summary: Words that are read.
inputs:
  text: {default: words.txt, help: words}
nodes:
  said: {rule: toy.shout, text: $text}
"""
LINES = """summary: Words that are said.
nodes:
  start: {rule: toy.start}
targets:
  default: [start]
"""


@pytest.fixture
def planned(space: Space, monkeypatch: pytest.MonkeyPatch) -> Space:
    monkeypatch.setattr(kept, "_OF_SHELL", kept._OF_SHELL | {"PYTEST_CURRENT_TEST"})
    (space.root / "rules").rename(space.root / "shelf")
    (space.root / "rules").symlink_to("shelf")
    space.write("site-packages/own.egg-info/PKG-INFO", "Version: 1\n")
    monkeypatch.setattr(sys, "path", [*sys.path, str(space.root / "site-packages")])
    Store(space.root / "cache")  # a verb that only reads makes none
    space.write("words.txt", "one two")
    space.write("recipes/say/read.yaml", READS)
    plan(space)
    return space


def session(space: Space, recipe: str = "say/read", added: Added | None = None) -> Session:
    return Session(space.project(), recipe, added)


def found(space: Space, recipe: str = "say/read") -> Kept | None:
    plans = session(space, recipe).planning._kept
    assert plans is not None
    return plans.find()


def plan(space: Space, recipe: str = "say/read") -> None:
    """Plan until the plan is kept: one is not while files may still change within a tick of the clock."""
    for _ in range(20):
        time.sleep(0.05)
        made = session(space, recipe).plan()
        again = found(space, recipe)
        if again is not None:
            assert again.plan == made
            return
    raise AssertionError("no plan was kept")


def keeping(path: Path, change: Callable[[], object]) -> None:
    """Change something, and give a file or folder back the time that it had, as `rsync -a` does."""
    before = path.stat().st_mtime_ns
    change()
    os.utime(path, ns=(before, before))


def switch(link: Path) -> None:
    """Let a link lead to a copy of the folder."""
    copy = shutil.copytree(link, link.with_name("copy"))
    link.unlink()
    link.symlink_to(copy)


CHANGES: dict[str, Callable[[Path], object]] = {
    "a rule, its time kept": lambda root: keeping(
        root / "rules/toy/shout.py", lambda: Space(root).edit("rules/toy/shout.py", "version=1", "version=2")
    ),
    "an imported module": lambda root: Space(root).edit("rules/toy/marks.py", 'b"!"', 'b"?"'),
    "a new backend": lambda root: (root / "rules/toy/shout_new.py").write_text(""),
    "a new module on the search path": lambda root: keeping(
        root / "site-packages", (root / "site-packages/newer.py").touch
    ),
    "the version of a distribution": lambda root: keeping(
        root / "site-packages/own.egg-info/PKG-INFO",
        lambda: (root / "site-packages/own.egg-info/PKG-INFO").write_text("Version: 2\n"),
    ),
    "a link": lambda root: switch(root / "rules"),
    "the recipe": lambda root: Space(root).edit("recipes/say/read.yaml", "text: $text", "text: $text, times: 2"),
    "the profile": lambda root: (root / "dxb.local.toml").write_text('profile = "stub"\n'),
    "no state": lambda root: next(root.rglob("state.db")).unlink(),
    "a damaged row": lambda root: spoil(root, lambda row: row[:-1]),
    "a row that says nothing": lambda root: spoil(root, lambda row: b"1\0"),
}


def spoil(root: Path, how: Callable[[bytes], bytes]) -> None:
    state = State(str(next(root.rglob("state.db"))))
    state.put("plan", {name: how(row) for name, row in state.all("plan").items()})


@pytest.mark.medium
def test_any_change_is_planned_anew(planned: Space) -> None:
    for name, change in CHANGES.items():
        change(planned.root)
        assert found(planned) is None, name
        plan(planned)


def test_another_kind_of_input_is_planned_anew(planned: Space) -> None:
    (planned.root / "words.txt").unlink()
    assert found(planned) is None
    (planned.root / "words.txt").mkdir()
    assert found(planned) is None
    planned.write("recipes/say/lines.yaml", LINES)
    planned.edit("recipes/say/read.yaml", "default: words.txt", "default: say/lines")
    plan(planned)
    planned.write("say/lines", "a file where a recipe was meant")
    assert found(planned) is None


def test_content_of_inputs_is_not_part_of_a_plan(planned: Space) -> None:
    planned.write("words.txt", "three")
    assert found(planned) is not None


def test_the_environment_and_the_request_are_part_of_it(planned: Space, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SHLVL", "7")
    assert found(planned) is not None
    monkeypatch.setenv("SIZE_OF_A_WORD", "7")  # a rule may take the default of an option from it
    assert found(planned) is None
    monkeypatch.delenv("SIZE_OF_A_WORD")
    other = session(planned, added=Added(settings=("said.times=3",)))
    assert not other.planning.recall()
    assert [call.options for _, call in other.plan().graph.calls()] == [{"times": 3}]


def test_a_build_notes_what_planning_read(planned: Space) -> None:
    """So that its snapshot, and `dxb watch`, know of it."""
    fresh, repeated = Watch(), Watch()
    session(planned).planning.resolve(watch=fresh)
    plans = session(planned).planning._kept
    assert plans is not None
    assert plans.find(repeated) is not None
    assert fresh.files.items() <= repeated.files.items()
    assert fresh.folders.items() <= repeated.folders.items()


def test_warnings_of_planning_are_repeated(planned: Space, monkeypatch: pytest.MonkeyPatch) -> None:
    planned.write("site-packages/unknown_thing.py", "")
    planned.edit("rules/toy/marks.py", '"""Marks."""', '"""Marks."""\ndef load():\n    import unknown_thing\n')
    plan(planned)
    told = []
    for _ in range(2):
        warnings.clear()
        session(planned).plan()
        told.append([*warnings])
    assert told[0] == told[1]
    assert "unknown_thing" in told[0][0]
    warnings.clear()


@pytest.mark.parametrize(
    "recipe",
    [
        "inputs: {text: {help: words}}\nnodes:\n  said: {rule: toy.shout, text: $text}\n",  # not given
        "nodes:\n  start: {rule: toy.start}\n  said: {rule: toy.spoken, text: $start, backend: cloud}\n",  # missing
        "nodes:\n  start: {rule: toy.start}\n  said: {rule: toy.spoken, text: $start, backend: [cloud, quiet]}\n",
    ],
)
def test_what_depends_on_more_than_files_is_not_kept(space: Space, recipe: str) -> None:
    Store(space.root / "cache")
    space.write("recipes/say/other.yaml", f"summary: Other words.\n{recipe}")
    for _ in range(4):
        time.sleep(0.05)
        session(space, "say/other").plan(incomplete=True)
        assert found(space, "say/other") is None


def test_a_cluster_gets_the_code_of_this_command(space: Space, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DXB_EXECUTOR", "ray")
    assert session(space).planning._kept is None


def test_warnings_are_those_of_the_recipe(planned: Space) -> None:
    planned.write("site-packages/unknown_thing.py", "")
    planned.write("rules/toy/start.py", f"import unknown_thing\n{(planned.root / 'rules/toy/start.py').read_text()}")
    project = planned.project()
    assert [Session(project, name).planning.resolve().warnings != [] for name in ("say/words", "say/read")] == [
        True,
        False,
    ]


def test_only_so_many_are_kept(planned: Space, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept, "_MOST", 2)
    for count in range(3):
        session(planned, added=Added(settings=(f"said.times={count}",))).plan()
    assert len(State(str(next(planned.root.rglob("state.db")))).all("plan")) == 2


def test_an_error_is_not_kept(planned: Space) -> None:
    for _ in range(2):
        with pytest.raises(UsageError, match="no node is called"):
            session(planned, added=Added(settings=("sad.times=3",))).plan()


@pytest.mark.slow
@pytest.mark.parametrize("recipe", ["twin/laptop_scene", "task/close_laptop", "benchmark/first_policies"])
def test_a_plan_comes_back_as_it_was(tmp_path: Path, recipe: str) -> None:
    made = Session(Project(tmp_path), recipe).planning.resolve(incomplete=True).plan
    again = read(write(replace(made, absent=())))
    assert again == replace(made, absent=())
    assert [list(call.options.items()) for _, call in again.graph.calls()] == [
        list(call.options.items()) for _, call in made.graph.calls()
    ]
