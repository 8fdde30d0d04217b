"""Nodes that read by themselves: what makes them stale, and that what they read travels with their results."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from dextera_build.bundle import importer
from dextera_build.bundle.closure_of_targets import survey
from dextera_build.bundle.config import Build, Contents
from dextera_build.bundle.export import Export
from dextera_build.bundle.layout import Layout
from dextera_build.engine.dry import plan as dry
from dextera_build.engine.graph import Address, Graph
from dextera_build.engine.run import RunResult, build
from dextera_build.gc.choose import Limits
from dextera_build.gc.collect import collect
from dextera_build.remotes.breaker import Guarded
from dextera_build.remotes.exchange import Exchange
from dextera_build.remotes.folder import Directory
from dextera_build.runs.events import NodeStarted
from dextera_build.store import traces
from dextera_build.store.signature import Watch
from dextera_build.store.store import Store
from tests.engine.inline import InlineExecutor
from tests.engine.tiny import Record, call, facts, graph, out, run, run_task
from tests.store.stores import age, entry

START = 4
"""With this `tiny.follow` begins at `leaf0`."""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    folder = tmp_path / "project"
    folder.mkdir()
    for number in (0, 1, 2):  # the length says which file comes next
        (folder / f"leaf{number}").write_text("." * (number + 5))
    return folder


def of(folder: Path) -> Graph:
    rule = facts(discovers=str(folder))
    read = call("read", "read", {"folder": str(folder), "start": START}, rule)
    return graph(read, call("reader", "pick", a=out("read")))


def built(folder: Path, store: Store, *remotes: Guarded, **flags: Any) -> tuple[RunResult, list[str]]:
    result, record = run(of(folder), store, exchange=Exchange(store, remotes), **flags)
    assert result.ok, result.nodes
    return result, record.with_status("ran")


def reads(result: RunResult, store: Store) -> list[str]:
    """The names that the last run of `read` asked for."""
    parts = traces.parts_of(store.blobs.get(result.nodes["read"].key or ""))
    assert parts is not None
    return [name for _, name, _ in parts[1] or ()]


def share(folder: Path, mode: str = "rw") -> Guarded:
    remote = Directory(folder)
    return Guarded("lab", remote.address, lambda: remote, mode=mode, timeout_s=5.0)


def edited(folder: Path, name: str, text: str) -> None:
    time.sleep(0.01)
    (folder / name).write_text(text)


def test_each_file_that_it_read_makes_it_stale_and_no_other(project: Path, store: Store) -> None:
    result, ran = built(project, store)
    assert "read" in ran
    assert built(project, store)[1] == []
    asked = set(reads(result, store))
    assert asked
    for name in ("leaf0", "leaf1", "leaf2", "leaf3"):
        path = project / name
        before = path.read_text() if path.exists() else None
        edited(project, name, f"{before} again")
        assert (built(project, store)[1][:1] == ["read"]) == (name in asked), name
        if before is None:
            path.unlink()
        else:
            edited(project, name, before)
        assert built(project, store)[1] == []  # the branch that was built before is found again


def test_the_plan_says_what_the_build_does(project: Path, store: Store) -> None:
    def statuses() -> list[str]:
        return [planned.status for planned in dry(of(project), [("reader",)], store)]

    assert statuses() == ["stale", "unknown"]
    result, _ = built(project, store)
    assert statuses() == ["cached", "cached"]
    edited(project, reads(result, store)[0], "other")
    assert statuses() == ["stale", "unknown"]


def test_an_edit_while_it_runs_fails_it(project: Path, store: Store) -> None:
    first = reads(built(project, store)[0], store)[0]
    edited(project, first, "second version")

    def meddling(task: Mapping[str, Any], emit: Callable[..., None]) -> dict[str, Any]:
        reply = run_task(task, emit)
        edited(project, first, "third version")
        return reply

    record = Record()
    result = build(of(project), [Address(("read",))], store=store, executor=InlineExecutor(meddling), listen=record)
    error = result.nodes["read"].error
    assert error is not None
    assert error.code == "DXB-B304"
    assert first in error.message
    assert built(project, store)[1][0] == "read"
    edited(project, first, "second version")
    assert built(project, store)[1][0] == "read"  # nothing was kept of the run that was disturbed


def test_an_edit_between_the_look_and_the_run_fails_it(project: Path, store: Store) -> None:
    """Other nodes of the run may rest on what the file was at the look."""
    first = reads(built(project, store)[0], store)[0]
    edited(project, first, "second version")

    def late(task: Mapping[str, Any], emit: Callable[..., None]) -> dict[str, Any]:
        edited(project, first, "third version")
        return run_task(task, emit)

    result = build(of(project), [Address(("read",))], store=store, executor=InlineExecutor(late), listen=Record())
    assert not result.ok


def test_two_nodes_with_one_key_run_once(project: Path, store: Store) -> None:
    rule = facts(discovers=str(project))
    read = call("read", "read", {"folder": str(project), "start": START}, rule)
    twin = graph(read, type(read)("twin", rule, read.options, {}, read.where), default=("read", "twin"))
    result, record = run(twin, store)
    assert len(record.of(NodeStarted)) == 1
    assert result.nodes["read"].key == result.nodes["twin"].key


def test_forced_it_runs_and_keeps_its_key(project: Path, store: Store) -> None:
    before = built(project, store)[0].nodes["read"].key
    after, ran = built(project, store, force=frozenset({"read"}))
    assert "read" in ran
    assert after.nodes["read"].key == before
    assert built(project, store)[1] == []


def test_a_remote_leads_to_every_branch_that_it_was_given(project: Path, tmp_path: Path) -> None:
    folder = tmp_path / "share"
    one, two = Store(tmp_path / "one"), Store(tmp_path / "two")
    first = reads(built(project, one, share(folder))[0], one)[0]
    text = (project / first).read_text()
    # The second never heard of the first one's branch, for it only writes.
    edited(project, first, "another branch")
    assert "read" in built(project, two, share(folder, "w"))[1]
    fresh = Store(tmp_path / "fresh")
    assert built(project, fresh, share(folder, "r"))[1] == []
    edited(project, first, text)
    assert built(project, fresh, share(folder, "r"))[1] == []
    edited(project, first, "a third branch")
    assert built(project, fresh, share(folder, "r"))[1][0] == "read"
    assert built(project, fresh)[1] == []


def test_a_remote_that_lies_is_a_miss(project: Path, store: Store, tmp_path: Path) -> None:
    folder = tmp_path / "share"
    built(project, store, share(folder))
    for path in folder.rglob("*"):
        if path.is_file() and path.stat().st_size > 200:
            data = path.read_bytes()
            path.chmod(0o644)
            path.write_bytes(data[:-1] + bytes([data[-1] ^ 1]))
    assert "read" in built(project, Store(tmp_path / "fresh"), share(folder, "r"))[1]


def test_a_bundle_brings_what_leads_to_its_results(project: Path, store: Store, tmp_path: Path) -> None:
    built(project, store)
    found = survey(of(project), [Address(("reader",))], store, "full", str)
    build = Build("tiny/graph", found.targets, "cpu", found.nodes)
    contents = Contents("full", "1.0", (build,), {})
    Export(store, contents).write(tmp_path / "bundle.tar")
    other = Store(tmp_path / "other")
    importer.take(importer.open_bundle(Layout(tmp_path / "bundle.tar")), other)
    assert built(project, other)[1] == []


def test_a_collection_keeps_what_leads_to_what_is_held(project: Path, store: Store) -> None:
    result, _ = built(project, store)
    edited(project, reads(result, store)[0], "another branch")
    held = built(project, store)[0].nodes
    keys = {str(node.key) for node in held.values()}
    for key in list(store.actions.keys()):
        age(entry(store, key), 1.0)
    collect(store, lambda: {"me": keys}, Limits(since=time.time() - 60.0), dry=False)
    assert built(project, Store(store.root))[1] == []


def test_lost_bytes_are_made_again(project: Path, store: Store) -> None:
    result, _ = built(project, store)
    for node in result.nodes.values():
        store.blobs.path(str(node.output)).unlink()
    again, ran = built(project, Store(store.root))
    assert "read" in ran
    assert again.nodes["read"].output == result.nodes["read"].output


def test_what_a_failed_call_read_is_watched(project: Path, store: Store) -> None:
    def failing(task: Mapping[str, Any], emit: Callable[..., None]) -> dict[str, Any]:
        emit("read", {"steps": run_task(task, emit)["reads"] + [["file", "missing.txt", "-"]]})
        raise ValueError("no")

    store.leaves.watch = Watch()
    result = build(of(project), [Address(("read",))], store=store, executor=InlineExecutor(failing), listen=Record())
    assert not result.ok
    assert store.leaves.watch.files[str(project / "missing.txt")] is None


def test_another_checkout_finds_the_same(project: Path, store: Store, tmp_path: Path) -> None:
    """No path of the machine is in the key: only the options name the folder here."""
    copy = tmp_path / "copy"
    shutil.copytree(project, copy)
    rule = facts(discovers=str(copy))
    options = {"folder": str(project), "start": START}
    built(project, store)
    elsewhere = graph(call("read", "read", options, rule))
    result, record = run(elsewhere, store)
    assert record.with_status("cached") == ["read"]
    edited(copy, "leaf1", "changed in the copy")
    edited(copy, "leaf3", "changed there, too")
    edited(copy, "leaf2", "and this")
    (planned,) = dry(elsewhere, [("read",)], store)
    assert planned.status == "stale"
    assert result.ok
