"""What dxb wrote down for itself and finds changed: it is forgotten or passed over, and the build is right."""

from __future__ import annotations

import json
import shutil
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dextera_build.bundle.closure_of_targets import survey
from dextera_build.engine.graph import Address
from dextera_build.gc import roots
from dextera_build.runs import events, log
from dextera_build.runs.history import Entry, History
from dextera_build.store.store import Store
from tests.bundle.conftest import small
from tests.engine.tiny import run
from tests.hostile.values import BYTES, mutate, torn

MANY = settings(
    max_examples=400, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
ENTRY = Entry("0" * 64, "1" * 64, "0001", 1.0, 2.0, {"memory_bytes": 3})


@pytest.fixture
def built(tmp_path: Path) -> Store:
    """A store with one small build in it."""
    (tmp_path / "photo.bin").write_bytes(b"photo")
    store = Store(tmp_path / "store")
    assert run(small(tmp_path / "photo.bin"), store)[0].ok
    return store


def local(store: Store) -> list[Path]:
    """Every file of its own that the build left."""
    folders = [store.local, store.root / "runs"]
    return sorted(path for folder in folders for path in folder.rglob("*") if path.is_file())


@pytest.mark.parametrize("name", BYTES)
def test_whatever_stands_in_its_own_files_a_build_goes_on(built, tmp_path, name):
    plan = small(tmp_path / "photo.bin")
    assert local(built)
    for path in local(built):
        path.chmod(0o644)
        path.write_bytes(BYTES[name])
    again, record = run(plan, Store(built.root))
    assert again.ok
    assert record.with_status("ran") == []
    store = Store(built.root)
    assert roots.find(store).vanished == []
    for each in log.runs(store):
        log.read(store, each)
    assert list(store.divergent.all()) == []


ROWS = [
    ["k"],
    [1, 2, 3, 4, 5, 6],
    ["k", "d", "r", "soon", 1.0],
    ["k", "d", "r", 1.0, 1.0, ["memory_bytes"]],
    ["k", "d", "r", 1.0, 1.0, {"memory_bytes": "much"}],
    {"key": "k"},
    3,
]


@pytest.mark.parametrize("row", ROWS)
def test_a_row_of_a_history_of_another_form_is_forgotten(tmp_path, row):
    store = Store(tmp_path)
    kept = History(store, "a/b")
    kept.note("x", ENTRY)
    kept.save()
    (kind,) = store.state.kinds()
    store.state.put(kind, {"a": json.dumps(row).encode()})
    fresh = History(store, "a/b")
    assert fresh.all() == {"x": ENTRY}
    assert fresh.peak_gb("a") is None
    roots.find(store)


def test_a_good_history_is_read(tmp_path):
    store = Store(tmp_path)
    kept = History(store, "a/b")
    kept.note("x", ENTRY)
    kept.save()
    assert History(store, "a/b").all() == {"x": ENTRY}


WRONG_EVENTS = [
    {"event": "node_finished"},
    {"event": "node_finished", "time": 1.0, "node": 3, "rule": "r"},
    {"event": "run_started", "time": "now"},
    {"event": 3},
    {"time": 1.0},
    ["event"],
    3,
]


@pytest.mark.parametrize("event", WRONG_EVENTS)
def test_a_line_that_is_no_event_is_left_out(tmp_path, event):
    store = Store(tmp_path)
    folder = store.root / "runs" / "0001"
    folder.mkdir(parents=True)
    good = events.NodeLog(1.0, "a", "said").to_line()
    (folder / "events.jsonl").write_text(f"{json.dumps(event)}\n{good}\n")
    assert [found["event"] for found in log.read(store, "0001")] == ["node_log"]


def test_every_event_that_dxb_writes_is_read_back(built):
    for each in log.runs(built):
        lines = (built.root / "runs" / each / "events.jsonl").read_bytes().splitlines()
        assert len(log.read(built, each)) == len(lines)


def test_names_of_runs_that_are_no_numbers_are_passed_over(tmp_path):
    store = Store(tmp_path)
    for name in ("²", "٣x", "-1", "1e5", "a\nb", "0001"):
        (store.root / "runs" / name).mkdir(parents=True)
    assert log.runs(store) == ["0001"]
    assert log.EventLog(store).run == "0002"


@pytest.mark.parametrize("place", range(4))
def test_a_divergence_of_another_form_is_passed_over(tmp_path, place):
    store = Store(tmp_path)
    key = "0" * 64
    store.divergent.note(key, "a", "1" * 64, "2" * 64, time.time())
    row = json.loads(store.state.all("divergent")[key])
    row[place] = 3 if place == 2 else [3]
    store.state.put("divergent", {key: json.dumps(row).encode()})
    assert list(store.divergent.all()) == []


def test_a_table_of_signatures_that_names_other_places_is_not_believed(tmp_path):
    file, secret = tmp_path / "photo.bin", tmp_path / "secret"
    file.write_bytes(b"photo")
    secret.write_bytes(b"photo")
    store = Store(tmp_path / "store")
    plan = small(file)
    run(plan, store)
    rows = {name: json.loads(data) for name, data in store.state.all("leaf").items()}
    store.state.put("leaf", {name: json.dumps([*row[:5], "../../../secret"]).encode() for name, row in rows.items()})
    found = survey(plan, [Address(name) for name in plan.targets["default"]], Store(store.root))
    assert found.stale == ()


def _in_line(value: object) -> bytes:
    return json.dumps(value).encode()


@pytest.mark.slow
@MANY
@given(data=st.data())
def test_changed_documents_are_read_or_forgotten(tmp_path, data):
    """History, log, divergences: no exception, whatever one value became."""
    root = tmp_path / "store"
    shutil.rmtree(root, ignore_errors=True)
    store = Store(root)
    kept = History(store, "a/b")
    kept.note("x", ENTRY)
    kept.save()
    store.divergent.note("0" * 64, "a", "1" * 64, "2" * 64, 1.0)
    folder = store.root / "runs" / "0001"
    folder.mkdir(parents=True)
    started = events.RunStarted(1.0, "0001", "a/b", ["x"], "cpu", "1", 1, 0)
    ended = events.NodeFinished(1.0, "x", "r", None, "ran", "k", "o", 1.0)
    (folder / "events.jsonl").write_text(f"{started.to_line()}\n{ended.to_line()}\n")
    path = data.draw(st.sampled_from(local(store)))
    text = path.read_bytes()
    if path.suffix == ".db" or data.draw(st.booleans()):
        text = torn(text, data)
    else:
        parts = [json.loads(part) for part in text.splitlines()]
        mutate(parts, data)
        text = b"\n".join(map(_in_line, parts))
    path.chmod(0o644)
    path.write_bytes(text)
    for entry in History(store, "a/b").all().values():
        assert isinstance(entry.key, str)
    assert all(isinstance(found["event"], str) for found in log.read(store, "0001"))
    log.latest(store, "a/b")
    list(store.divergent.all())
    roots.find(store)
