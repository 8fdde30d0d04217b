"""A deleted file of the store shows, at whatever time it is deleted, and nothing else costs a look at each file."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from dextera_build.engine import snapshot
from dextera_build.store import presence
from dextera_build.store.entry import ActionResult
from dextera_build.store.presence import Presence
from dextera_build.store.signature import Watch
from dextera_build.store.store import Store

REQUEST = {"targets": ["all"]}


@pytest.fixture
def made(tmp_path: Path) -> tuple[Store, Path]:
    """A store with two hundred results and a snapshot that relies on them, all at rest."""
    store = Store(tmp_path / "cache")
    store.actions.presence = found = Presence(str(store.root))
    for number in range(200):
        publish(store, number)
    time.sleep(0.05)
    file = tmp_path / "snapshot"
    assert snapshot.save(file, REQUEST, Watch(), [], (str(store.root), found))
    return store, file


def publish(store: Store, number: int) -> str:
    output = store.blobs.put(b'{"artifact":"T","fields":{"n":%d}}' % number)
    document = store.blobs.put(b"%d" % number)
    store.actions.put(document, ActionResult(output, "", (), {}, 0.0, None, document))
    return document


def is_fresh(file: Path) -> bool:
    return snapshot.load_if_fresh(file, REQUEST) is not None


def test_a_quiet_store_is_not_looked_through(made: tuple[Store, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    _, file = made
    looks: list[str] = []
    monkeypatch.setattr(presence, "whole", lambda root, rows, shard, row: looks.append(shard) or True)
    assert is_fresh(file)
    assert looks == []


@pytest.mark.parametrize("area", ["cas", "ac"])
def test_any_deleted_file_shows(made: tuple[Store, Path], area: str) -> None:
    store, file = made
    for path in sorted((store.root / area).glob("??/*"))[::7]:
        data, times = path.read_bytes(), path.parent.stat()
        path.unlink()
        assert not is_fresh(file), path
        path.write_bytes(data)
        os.utime(path.parent, ns=(times.st_atime_ns, times.st_mtime_ns))
    assert is_fresh(file)


def test_what_others_add_is_looked_at_once(made: tuple[Store, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    store, file = made
    for number in range(200, 300):
        publish(store, number)
    time.sleep(0.05)
    assert is_fresh(file)
    monkeypatch.setattr(presence, "whole", lambda root, rows, shard, row: pytest.fail(shard))
    assert is_fresh(file)


def test_a_folder_that_just_moved_is_not_trusted(tmp_path: Path) -> None:
    store = Store(tmp_path / "cache")
    store.actions.presence = found = Presence(str(store.root))
    blob = store.blobs.path(publish(store, 0))
    soon = (time.time_ns() + 60_000_000_001,) * 2  # it moved no earlier than the look, however slowly the test goes on
    os.utime(blob.parent, ns=soon)
    file = tmp_path / "snapshot"
    assert snapshot.save(file, REQUEST, Watch(), [], (str(store.root), found))
    blob.unlink()
    # As if it had been deleted within the same tick of the clock.
    os.utime(blob.parent, ns=soon)
    assert not is_fresh(file)


@pytest.mark.parametrize("what", ["short", "gone"])
def test_after_a_power_cut_sizes_are_looked_at(
    made: tuple[Store, Path], monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    store, file = made
    path = next((store.root / "cas").glob("??/*"))
    state = path.parent.stat()
    path.chmod(0o644)
    if what == "short":
        path.write_bytes(b"")
    else:
        path.unlink()
    os.utime(path.parent, ns=(state.st_atime_ns, state.st_mtime_ns))
    monkeypatch.setattr(presence, "boot", lambda: "another")
    assert not is_fresh(file)


@pytest.mark.parametrize("room", ["room", "no room"])
def test_rows_that_were_laid_aside_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: str) -> None:
    store = Store(tmp_path)
    every, few = Presence(str(tmp_path)), Presence(str(tmp_path))
    keys = [publish(store, number) for number in range(60)] * 2
    monkeypatch.setattr(presence, "_MOST_HELD", 7)
    if room == "no room":
        monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "nowhere"))
    noted = []
    for key in keys:
        entry = store.actions.entry(key)
        assert entry is not None
        few.note(key, entry.files)
        noted.append((key, entry.files))
    monkeypatch.setattr(presence, "_MOST_HELD", 10**9)
    for each in noted:
        every.note(*each)
    rows: list[bytes] = []
    wanted: list[bytes] = []
    found, shards = few.freeze(rows.append), every.freeze(wanted.append)
    assert found is not None
    assert shards is not None
    assert rows == wanted
    assert [row[1:] for row in found.values()] == [row[1:] for row in shards.values()]


def test_what_is_gone_already_is_not_written_down(made: tuple[Store, Path]) -> None:
    store, file = made
    store.actions.presence = found = Presence(str(store.root))
    key = publish(store, 1)
    store.blobs.path(key).unlink()
    assert not snapshot.save(file, REQUEST, Watch(), [], (str(store.root), found))
    assert not file.exists()


def test_a_snapshot_says_what_it_holds_on_to(made: tuple[Store, Path]) -> None:
    store, file = made
    assert snapshot.held(file) == ("", set(store.actions.keys()))


@pytest.mark.parametrize("junk", [b"", b"x" * 400])
def test_broken_rows_are_not_trusted(made: tuple[Store, Path], monkeypatch: pytest.MonkeyPatch, junk: bytes) -> None:
    _, file = made
    Path(f"{file}.rows").chmod(0o644)
    Path(f"{file}.rows").write_bytes(junk)
    monkeypatch.setattr(presence, "boot", lambda: "another")
    assert not is_fresh(file)
