"""What is remembered: dry runs, history, event logs and snapshots."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from dextera_build import digest
from dextera_build.engine.dry import Planned, plan
from dextera_build.engine.graph import Address, Graph
from dextera_build.engine.policy import RunPolicy
from dextera_build.engine.run import build
from dextera_build.errors import RecipeError, UsageError
from dextera_build.runs import log as eventlog
from dextera_build.runs import snapshot
from dextera_build.runs.events import Event, NodeFinished, RunStarted, fan_out
from dextera_build.runs.history import Entry, History
from dextera_build.runs.log import EventLog
from dextera_build.store import signature
from dextera_build.store.signature import Watch
from dextera_build.store.store import Store
from tests.engine.tiny import Record, call, every, graph, group, inline, item, leaf, out


def scene(seg: int = 0, mesh: int = 0) -> Graph:
    return graph(
        call("cam", value=seg),
        call("seg", "items", {"box": "b", "mug": "m"}, x=out("cam")),
        group("body", out("seg"), call("mesh", value=mesh, i=item("body"))),
        call("scene", all=every("body.mesh")),
        call("unasked"),
    )


def run(what: Graph, store: Store, run: str = "0001") -> None:
    build(what, [("scene",)], store=store, executor=inline(), listen=Record(), policy=RunPolicy(run=run))


def statuses(found: Sequence[Planned]) -> dict[str, str]:
    return {node.address: node.status for node in found}


def test_a_plan_of_nothing_built_names_open_groups(store: Store) -> None:
    found = statuses(plan(scene(), [("scene",)], store))
    assert found == {"cam": "stale", "seg": "unknown", "body.mesh": "unknown", "scene": "unknown"}
    assert list(found) == ["cam", "seg", "body.mesh", "scene"]


def test_a_plan_knows_what_is_cached(store: Store) -> None:
    run(scene(), store)
    found = plan(scene(mesh=1), [("scene",)], store, history=History(store, "tiny/graph"))
    assert statuses(found) == {
        "cam": "cached",
        "seg": "cached",
        "body[box].mesh": "stale",
        "body[mug].mesh": "stale",
        "scene": "unknown",
    }
    for node in found:
        assert node.seconds_last is not None
        assert (node.key is None) == (node.status == "unknown")
        assert node.key is None or digest.of_bytes(node.key_document) == node.key
        assert bool(node.key_document) == (node.status != "unknown")
        assert (node.output is None) == (node.status != "cached")
    assert set(statuses(plan(scene(), [("scene",)], store)).values()) == {"cached"}


def test_a_plan_of_an_open_group_remembers_its_copies(store: Store) -> None:
    run(scene(), store)
    found = plan(scene(seg=1), [("scene",)], store, history=History(store, "tiny/graph"))
    (mesh,) = [node for node in found if node.address == "body.mesh"]
    assert mesh.seconds_last is not None
    assert mesh.seconds_last > 0


def test_a_plan_refuses_what_a_build_refuses(store: Store, tmp_path: Path) -> None:
    run(scene(), store)
    with pytest.raises(UsageError, match="there is no `mgu` in `body`"):
        plan(scene(), [Address(("body", "mesh"), ("mgu",))], store)
    with pytest.raises(RecipeError, match="there is no file"):
        plan(graph(call("a", f=leaf(tmp_path / "nope"))), [("a",)], store)
    copies = group("g", out("a"), call("b", f=leaf(tmp_path / "nope"), i=item("g")))
    with pytest.raises(RecipeError, match="there is no file"):
        plan(graph(call("a", "items", {"x": 1}), copies), [("g", "b")], store)


def test_history_is_kept_by_recipe_and_project(store: Store) -> None:
    history = History(store, "twin/laptop", "/projects/a")
    entry = Entry("k" * 64, "d" * 64, "0007", 1.5, 123.0)
    history.note("body[mug].mesh", entry)
    history.save()
    assert History(store, "twin/laptop", "/projects/a").all() == {"body[mug].mesh": entry}
    assert History(store, "twin/laptop", "/projects/b").all() == {}
    assert History(store, "twin/other", "/projects/a").get("body[mug].mesh") is None


def test_history_names_the_run_that_gave_the_key(store: Store) -> None:
    history = History(store, "a")
    history.note("n", Entry("k1", "d1", "0001", 1.0, 1.0))
    history.note("n", Entry("k1", "d1", "0002", 1.0, 2.0))
    assert history.all()["n"].run == "0001"
    history.note("n", Entry("k2", "d2", "0003", 1.0, 3.0))
    assert history.all()["n"].run == "0003"


def test_a_failed_run_changes_no_entry_that_is_given(store: Store) -> None:
    entries = {key: Entry(key, key, "0001", 1.0, 1.0) for key in ("k1", "k2", "k3")}
    for key, ok in (("k1", True), ("k2", False), ("k3", False)):
        history = History(store, "a")
        history.note("n", entries[key])
        history.save(ok=ok)
    assert (History(store, "a").all()["n"], History(store, "a").get("n")) == (entries["k1"], entries["k3"])
    history = History(store, "a")
    history.note("n", entries["k3"])
    history.save()
    assert History(store, "a").all()["n"] == entries["k3"]


def test_builds_at_once_lose_nothing_of_one_another(store: Store) -> None:
    one, other = History(store, "a"), History(store, "a")
    assert (one.all(), other.all()) == ({}, {})
    for history, name in ((one, "n"), (other, "m")):
        history.note(name, Entry("k1", "d1", "0001", 1.0, 1.0))
        history.save()
    assert History(store, "a").all().keys() == {"n", "m"}


def started(recipe: str, run: str = "") -> RunStarted:
    return RunStarted(1.0, run, recipe, ["scene"], "cpu", "0.1", 3, 1)


def test_a_log_gives_back_what_was_told(store: Store) -> None:
    record = Record()
    with EventLog(store) as log:
        build(scene(), [("scene",)], store=store, executor=inline(), listen=fan_out(log, record))
        assert log.run == "0001"
    events = eventlog.read(store, "0001")
    assert [event["event"] for event in events] == [event.kind for event in record.events]
    last = [event for event in events if event["event"] == "node_finished"][-1]
    assert last == {**record.of(NodeFinished)[-1].__dict__, "event": "node_finished"}


def test_run_ids_count_up_and_are_never_shared(store: Store) -> None:
    logs: list[EventLog] = []

    def several() -> None:
        logs.extend(EventLog(store) for _ in range(10))

    threads = [threading.Thread(target=several) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(log.run for log in logs) == [f"{n:04d}" for n in range(1, 41)]
    for log in logs:
        log.close()


def test_the_latest_run_of_a_recipe(store: Store) -> None:
    for recipe in ("twin/a", "twin/b", "twin/a"):
        with EventLog(store) as log:
            log(started(recipe))
    with EventLog(store):
        pass  # killed before it began
    assert eventlog.runs(store) == ["0001", "0002", "0003", "0004"]
    assert eventlog.latest(store, "twin/a") == "0003"
    assert eventlog.latest(store, "twin/b") == "0002"
    assert eventlog.latest(store) == "0003"
    assert eventlog.latest(store, "twin/c") is None
    assert eventlog.latest(store, "twin/a", ok=True) is None
    (store.root / "runs" / "9999").mkdir()
    with EventLog(store) as log:
        assert log.run == "10000"
    assert eventlog.runs(store)[-1] == "10000"


def test_a_torn_last_line_is_left_out(store: Store) -> None:
    with EventLog(store) as log:
        log(started("twin/a"))
        log(Event(2.0))
    path = store.root / "runs" / "0001" / "events.jsonl"
    path.write_bytes(path.read_bytes()[:-4])
    assert [event["time"] for event in eventlog.read(store, "0001")] == [1.0]


@pytest.mark.parametrize("name", ["0009", "", "nope"])
def test_an_unknown_run_lists_what_there_is(store: Store, name: str) -> None:
    with EventLog(store):
        pass
    with pytest.raises(UsageError, match=f"there is no run `{name}`") as caught:
        eventlog.read(store, name)
    assert caught.value.facts["runs"] == "0001"


@pytest.fixture
def files(tmp_path: Path) -> Path:
    folder = tmp_path / "project"
    folder.mkdir()
    for number in range(5):
        (folder / f"{number}.py").write_text(str(number))
        os.utime(folder / f"{number}.py", ns=(1_600_000_000_000_000_001,) * 2)
    (folder / "blob").write_text("1234")
    time.sleep(0.05)
    return folder


WORDS = ["build", "a"]


def watch(folder: Path) -> Watch:
    found = Watch()
    for number in range(5):
        found.file(folder / f"{number}.py")
    found.file(folder / "absent.toml")
    found.folder(folder)
    found.present[str(folder / "blob")] = signature.of((folder / "blob").stat())
    return found


def saved(store: Store, seen: Watch) -> bool:
    recipe = snapshot.Recipe("a", 3, "", "name", "", [str(store.root)])
    return snapshot.save(store.state, WORDS, seen, [recipe], "scene\tout/scene.xml\n", told=True)


def answers(store: Store, words: Sequence[str] = WORDS) -> bool:
    return snapshot.answer(words, str(store.root))


def test_a_snapshot_holds_as_long_as_nothing_changes(
    store: Store, files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert not answers(store)
    assert saved(store, watch(files))
    assert answers(store)
    said = capsys.readouterr()
    assert said.out == "scene\tout/scene.xml\n"
    assert said.err.startswith("a is up to date   3 nodes")
    assert not answers(store, [*WORDS, "--profile", "stub"])
    (files / "__pycache__").mkdir()  # not content
    assert answers(store)


@pytest.mark.parametrize("change", ["edit", "touch", "delete", "add", "appear", "replace", "lose", "edit an output"])
def test_any_change_ends_it(store: Store, files: Path, tmp_path: Path, change: str) -> None:
    assert saved(store, watch(files))
    target = files / "3.py"
    if change in ("edit", "edit an output"):
        target = target if change == "edit" else files / "blob"
        before = target.stat()
        target.write_text("4" * before.st_size)
        os.utime(target, ns=(before.st_atime_ns, before.st_mtime_ns))
    elif change == "touch":
        target.touch()
    elif change == "delete":
        target.unlink()
    elif change == "add":
        (files / "new.py").write_text("")
    elif change == "appear":
        (files / "absent.toml").write_text("")
    elif change == "replace":
        (tmp_path / "other").write_text("3")
        os.replace(tmp_path / "other", target)
    else:
        (files / "blob").unlink()
    assert not answers(store)


def test_an_entry_that_is_gone_ends_it(store: Store, files: Path, tmp_path: Path) -> None:
    entry = tmp_path / "entry"
    entry.write_text("")
    recipe = snapshot.Recipe("a", 3, "", "name", "", [str(entry)])
    assert snapshot.save(store.state, WORDS, watch(files), [recipe], "", told=False)
    assert answers(store)
    entry.unlink()
    assert not answers(store)


def test_what_is_not_at_rest_is_not_trusted(store: Store, files: Path) -> None:
    (files / "1.py").write_text("just now")
    soon = time.time_ns() + 60_000_000_001  # however slowly the test goes on, it was written no earlier than the look
    os.utime(files / "1.py", ns=(soon, soon))
    assert not saved(store, watch(files))
    os.utime(files / "1.py", ns=(1, 1))
    time.sleep(0.05)
    seen = watch(files)
    (files / "2.py").write_text("while building")
    assert not saved(store, seen)
    assert not answers(store)


def test_a_folder_that_just_moved_is_listed(store: Store, files: Path) -> None:
    seen = watch(files)
    os.utime(files)  # so soon that a name that comes now may leave the same time stamp
    assert saved(store, seen)
    state = files.stat()
    (files / "6.py").write_text("")
    os.utime(files, ns=(state.st_atime_ns, state.st_mtime_ns))
    assert not answers(store)


@pytest.mark.parametrize("junk", [b"", b"{", b"\0" * 9, b"a\0b\0c\0d", b"a\0\x001\0b"])
def test_a_row_of_another_form_is_no_answer(store: Store, files: Path, junk: bytes) -> None:
    assert saved(store, watch(files))
    store.state.put(snapshot.KIND, dict.fromkeys(store.state.all(snapshot.KIND), junk))
    assert not answers(store)
