"""The results that a collection keeps, from history and lock files."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest

from dextera_build.engine.policy import RunPolicy
from dextera_build.engine.run import build
from dextera_build.gc import roots
from dextera_build.gc.collect import collect_all
from dextera_build.runs import workspaces
from dextera_build.runs.history import Entry, History
from dextera_build.store.store import Store
from tests.engine.tiny import Record, call, graph, inline, out

KEY = "ab" * 32


def run(store: Store, project: Path, value: int = 0) -> set[str]:
    plan = graph(call("a", value=value), call("b", a=out("a")))
    policy = RunPolicy(run="0001", project=str(project), workspace=str(project))
    result = build(plan, [("b",)], store=store, executor=inline(), listen=Record(), policy=policy)
    return {node.key or "" for node in result.nodes.values()}


def test_what_a_project_built_last_is_held_by_its_name(store: Store, tmp_path: Path) -> None:
    old, new = run(store, tmp_path, 0), run(store, tmp_path, 1)
    assert roots.find(store).keys == {str(tmp_path): new}
    collect_all(store, size=0, dry=False)
    assert set(store.actions.keys()) == new
    assert old != new


def test_a_history_of_no_project_is_held(store: Store) -> None:
    plan = graph(call("a"))
    build(plan, [("a",)], store=store, executor=inline(), listen=Record())
    (key,) = (entry.key for entry in History(store, "tiny/graph").all().values())
    assert roots.find(store).keys == {roots.NOBODY: {key}}


@pytest.mark.parametrize("name", ["a\0b", "\ud800", "x" * 5000])
def test_a_history_whose_project_can_be_no_folder_holds_nothing(store: Store, name: str) -> None:
    _noted(store, name)
    found = roots.find(store)
    assert (found.keys, len(found.vanished)) == ({}, 1)


def _noted(store: Store, project: str) -> History:
    history = History(store, "a", project)
    history.note("n", Entry(KEY, KEY, "0001", 1.0, 1.0))
    history.save()
    return history


@pytest.mark.parametrize(
    "text", [f'[targets]\nscene = "{KEY}"\n', json.dumps({"scene": {"key": KEY}}), f"scene {KEY}\n<<<<<<< torn"]
)
def test_a_lock_file_of_any_form_holds_its_keys(store: Store, tmp_path: Path, text: str) -> None:
    keys = run(store, tmp_path)
    (tmp_path / roots.LOCKFILE).write_text(text)
    assert roots.find(store).keys == {str(tmp_path): keys | {KEY}}


def test_a_vanished_project_holds_nothing(store: Store, tmp_path: Path) -> None:
    project = tmp_path / "project"
    project.mkdir()
    run(store, project)
    project.rmdir()
    found = roots.find(store)
    assert (found.keys, found.vanished) == ({}, [str(project)])


def test_the_past_of_a_request_with_flags_holds_its_results_for_a_month(store: Store, tmp_path: Path) -> None:
    keys = ["ab" * 32, "cd" * 32, "ef" * 32]
    for variant, key, days in (("", keys[0], 40.0), ("@a=1-12345678", keys[1], 40.0), ("@a=2-12345678", keys[2], 20.0)):
        history = History(store, "tiny/graph", str(tmp_path), variant)
        history.note("a", Entry(key, key, "0001", 1.0, time.time() - days * 86400))
        history.save()
    assert roots.find(store).keys == {str(tmp_path): {keys[0], keys[2]}}


def test_what_another_machine_built_is_held_for_a_month(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workspaces, "_machine", lambda: "far")
    far = workspaces.name("/no/such/lab", shared=True)
    monkeypatch.undo()
    for node, key, days in (("a", "ab" * 32, 40.0), ("b", "cd" * 32, 20.0)):
        history = History(store, "tiny/graph", far)
        history.note(node, Entry(key, key, "0001", 1.0, time.time() - days * 86400))
        history.save()
    found = roots.find(store)
    assert (found.keys, found.vanished) == ({"/no/such/lab on another machine": {"cd" * 32}}, [])


def test_what_a_failed_run_replaced_is_held(store: Store, tmp_path: Path) -> None:
    old, new = "ab" * 32, "cd" * 32
    for key, ok in ((old, True), (new, False)):
        history = History(store, "tiny/graph", str(tmp_path))
        history.note("a", Entry(key, key, "0001", 1.0, time.time()))
        history.save(ok=ok)
    assert roots.find(store).keys == {str(tmp_path): {old, new}}
