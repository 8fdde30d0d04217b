"""Collection of a store: which files are removed and which stay."""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from dextera_build import digest
from dextera_build.errors import StoreError
from dextera_build.gc import inventory
from dextera_build.gc.choose import Limits
from dextera_build.gc.collect import collect, collect_all
from dextera_build.gc.verify import verify
from dextera_build.store.results import Found
from dextera_build.store.store import Store
from tests.store.stores import (
    DAY,
    age,
    age_all,
    assert_whole,
    contents,
    entry,
    harm,
    held,
    key_of,
    keys,
    nobody,
    publish,
    rows,
)


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "store")


def test_a_dry_run_says_what_would_go_and_changes_nothing(store: Store) -> None:
    publish(store, "old", [b"1"])
    age_all(store, time.time() - 9 * DAY)
    before = contents(store)
    said = collect(store, nobody, Limits(size=0))
    assert rows(said) == {"results": 1, "blobs": 3}
    assert contents(store) == before


def test_only_garbage_goes_without_limits(store: Store) -> None:
    publish(store, "old", [b"1"])
    lost = store.blobs.put(b"of nobody")
    age_all(store, time.time() - 9 * DAY)
    said = collect(store, nobody, dry=False)
    assert rows(said) == {"blobs": 1}
    assert not store.blobs.has(lost)
    assert_whole(store)


def test_the_longest_unused_go_first_down_to_the_size(store: Store) -> None:
    for number in range(4):
        publish(store, f"r{number}", [b"%d" % number * 1000])
    for number in range(4):
        age(entry(store, key_of(f"r{number}")), time.time() - (9 - number) * DAY)
    half = inventory.read(store).bytes() // 2
    said = collect(store, nobody, Limits(size=half), dry=False)
    assert keys(store) == {key_of("r2"), key_of("r3")}
    assert said.after == inventory.read(store).bytes() == half
    assert_whole(store)


def test_what_was_not_used_for_longer_than_the_age_goes(store: Store) -> None:
    old, new = publish(store, "old"), publish(store, "new")
    age(entry(store, old), time.time() - 3 * DAY)
    collect(store, nobody, Limits(since=time.time() - 2 * DAY), dry=False)
    assert keys(store) == {new}


def test_a_hit_is_a_use(store: Store) -> None:
    used, unused = publish(store, "used"), publish(store, "unused")
    age_all(store, time.time() - 3 * DAY)
    assert store.actions.get(used) is not None
    collect(store, nobody, Limits(since=time.time() - 2 * DAY), dry=False)
    assert keys(store) == {used}
    assert unused not in keys(store)


def test_a_second_hit_within_the_hour_writes_nothing(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    key = publish(store, "a", [b"1"])
    age_all(store, time.time() - 3 * DAY)
    assert store.actions.get(key) is not None

    def refuse(*arguments: object) -> None:
        raise AssertionError("the stamp was renewed again")

    monkeypatch.setattr("os.utime", refuse)
    assert store.actions.get(key) is not None


def test_roots_stay_above_every_limit_and_that_is_said(store: Store) -> None:
    root = publish(store, "root", [b"x" * 1000])
    publish(store, "other")
    age_all(store, time.time() - 9 * DAY)
    said = collect(store, held(root, key_of("never built")), Limits(size=10, since=time.time()), dry=False)
    assert keys(store) == {root}
    assert said.after > 10
    assert [(row.kind, row.count, row.why) for row in said.stays] == [("results", 1, "built last by someone")]
    assert_whole(store)


def test_a_bare_result_is_collected_as_any_other(store: Store) -> None:
    key = publish(store, "bare", [b"large"])
    store.blobs.path(digest.of_bytes(b"large")).unlink()
    result = store.actions.known(key)
    assert result is not None
    store.actions.put(key, result, may_lack=True)
    age_all(store, time.time() - 9 * DAY)
    collect(store, held(key), Limits(size=0), dry=False)
    assert store.actions.find(key) == Found(result, False)
    age_all(store, time.time() - 9 * DAY)
    collect(store, nobody, Limits(size=0), dry=False)
    assert keys(store) == set()
    assert list(store.blobs.all()) == []


def test_a_blob_of_two_results_goes_with_the_second(store: Store) -> None:
    one, two = publish(store, "one", [b"both"]), publish(store, "two", [b"both"])
    age_all(store, time.time() - 9 * DAY)
    collect(store, held(two), Limits(size=0), dry=False)
    assert keys(store) == {two}
    assert one not in keys(store)
    assert store.blobs.get(digest.of_bytes(b"both")) == b"both"


def test_results_that_lack_a_blob_or_cannot_be_read_go_even_as_roots(store: Store) -> None:
    lacking, torn = publish(store, "lacking", [b"1"]), publish(store, "torn", [b"2"])
    store.blobs.path(digest.of_bytes(b"1")).unlink()
    harm(entry(store, torn), b"\x12\xff")
    age_all(store, time.time() - 9 * DAY)
    said = collect(store, held(lacking, torn), dry=False)
    assert keys(store) == set()
    assert next((row.kind, row.count, row.why) for row in said.gone) == (
        "results",
        2,
        "they lack a blob or cannot be read",
    )


def test_young_blobs_without_a_result_stay_for_a_result_to_come(store: Store) -> None:
    young = store.blobs.put(b"just written")
    said = collect(store, nobody, Limits(size=0), dry=False)
    assert store.blobs.has(young)
    assert [(row.kind, row.count, row.why) for row in said.stays] == [
        ("blobs", 1, "no result needs them, but they were used of late")
    ]


def test_a_blob_that_is_put_again_is_young_again(store: Store) -> None:
    name = store.blobs.put(b"once")
    age_all(store, time.time() - 9 * DAY)
    store.blobs.put(b"once")
    collect(store, nobody, dry=False)
    assert store.blobs.has(name)


def test_leftovers_go_but_not_those_of_now(store: Store) -> None:
    workshop = store.blobs.root / ".tmp"
    workshop.mkdir(parents=True)
    dead, living = workshop / ".tmp-dead-1-1", workshop / ".tmp-living-1-1"
    for path in (dead, living):
        path.write_bytes(b"half")
    aside = store.local / "quarantine" / key_of("damaged")
    aside.parent.mkdir(parents=True)
    aside.write_bytes(b"bad")
    for path in (dead, aside):
        age(path, time.time() - DAY)
    assert rows(collect(store, nobody, dry=False)) == {"leftovers": 2}
    assert [path.exists() for path in (dead, living, aside)] == [False, True, False]


def test_folders_that_were_made_aside_count_as_leftovers(store: Store) -> None:
    folder = store.blobs.root / ".tmp-made-aside"
    folder.mkdir(parents=True)
    age(folder, time.time() - DAY)
    assert rows(collect(store, nobody, dry=False)) == {"leftovers": 1}
    assert not folder.exists()


def test_what_the_system_does_not_let_go_of_stays(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    key = publish(store, "old")
    age(entry(store, key), time.time() - DAY)

    def refuse(path: str) -> None:
        raise PermissionError(errno.EPERM, "Operation not permitted", path)

    monkeypatch.setattr(os, "unlink", refuse)
    collect(store, nobody, Limits(size=0), dry=False)
    monkeypatch.undo()
    assert keys(store) == {key}
    assert store.actions.get(key) is not None


def test_saved_progress_goes_by_age_unless_the_call_runs(store: Store) -> None:
    for name in ("dead", "running"):
        folder = store.keep.path(key_of(name))
        folder.mkdir(parents=True)
        (folder / "state").write_bytes(b"x")
        for path in (folder / "state", folder):
            age(path, time.time() - 9 * DAY)
    assert store.locks.take(key_of("running"))
    try:
        collect(store, nobody, Limits(since=time.time() - DAY), dry=False)
        assert [key for key, _, _ in store.keep.all()] == [key_of("running")]
    finally:
        store.locks.release(key_of("running"))


def test_what_a_running_build_may_need_stays(store: Store) -> None:
    young, old = publish(store, "young"), publish(store, "old")
    age(entry(store, old), time.time() - DAY)
    with store.running.announced(), store.running.announced():  # a build, and the placing of its results
        said = collect(store, nobody, Limits(size=0), dry=False)
        assert keys(store) == {young}
        assert said.running
    collect(store, nobody, Limits(size=0), dry=False)
    assert keys(store) == set()


def test_a_store_that_may_only_be_read_is_not_collected(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    publish(store, "a")
    monkeypatch.setattr("os.access", lambda path, mode: False)
    with pytest.raises(StoreError, match="read-only, nothing can be collected") as caught:
        collect(store, nobody, dry=False)
    assert caught.value.code == "DXB-S401"
    assert collect(store, nobody).before > 0  # a dry run changes nothing


@pytest.mark.parametrize(
    "place",
    ["cas", "ac", "runs", "local", "local/quarantine", "local/keep", "local/running", "cas/ab", "ac/ab", "runs/7"],
)
@pytest.mark.parametrize("remove", [collect_all, verify], ids=["collect", "repair"])
def test_a_link_in_the_place_of_a_folder_is_refused(
    store: Store, tmp_path: Path, place: str, remove: Callable[..., object]
) -> None:
    publish(store, "a")
    precious = cherished(tmp_path)
    (store.root / "aside").mkdir()
    if os.path.lexists(store.root / place):
        (store.root / place).rename(store.root / "aside" / "was")
    (store.root / place).parent.mkdir(parents=True, exist_ok=True)
    (store.root / place).symlink_to(tmp_path / "precious")
    with pytest.raises(StoreError, match="a link lies in the store") as caught:
        remove(store, **{"dry": False} if remove is collect_all else {"repair": True})
    assert caught.value.code == "DXB-S403"
    assert caught.value.facts["link"] == str(store.root / place)
    assert all(path.exists() for path in precious)


@pytest.mark.parametrize("place", ["out", "more", "more/below", "cas/ab/.tmp-1", "local/quarantine/a", "local/keep/b"])
def test_what_other_links_lead_to_stays(store: Store, tmp_path: Path, place: str) -> None:
    publish(store, "a")
    precious = cherished(tmp_path)
    link = store.root / place
    link.parent.mkdir(parents=True, exist_ok=True)
    link.symlink_to(tmp_path / "precious")
    os.utime(link, (0, 0), follow_symlinks=False)
    verify(store, repair=True)
    collect(store, nobody, Limits(size=0, since=time.time()), dry=False)
    collect(store, nobody, dry=False)
    assert all(path.exists() for path in precious)
    assert link.is_symlink() == (place in ("out", "more", "more/below"))


def cherished(root: Path) -> list[Path]:
    """Old files that somebody else needs, some with the names of files of a store."""
    names = ("thesis", ".tmp-0123456789abcdef", "below/.tmp-1/thesis", "ab/cd", "3/events.jsonl", "0123456789abcdef")
    paths = [root / "precious" / name for name in names]
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("x")
    for path in (root / "precious").rglob("*"):
        age(path, time.time() - 400 * DAY)
    return paths
