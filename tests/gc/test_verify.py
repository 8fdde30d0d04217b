"""Verification of a store: every kind of damage is found, and repair turns it into a miss."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from dextera_build import digest
from dextera_build.errors import StoreError
from dextera_build.gc.verify import Verdict, verify
from dextera_build.store.store import Store
from tests.store.stores import age, entry, harm, key_of, publish


@pytest.fixture
def store(tmp_path: Path) -> Store:
    made = Store(tmp_path / "store")
    for number in range(5):
        publish(made, f"r{number}", [b"%d" % number * 100])
    return made


def blob(store: Store, number: int) -> Path:
    return store.blobs.path(digest.of_bytes(b"%d" % number * 100))


def kinds(verdict: Verdict) -> list[str]:
    return [finding.kind for finding in verdict.findings]


def test_a_whole_store_has_nothing_to_find(store: Store) -> None:
    verdict = verify(store)
    assert verdict.findings == []
    assert (verdict.blobs, verdict.results) == (len(list(store.blobs.all())), 5)
    assert verdict.bytes == sum(size for _, size in store.blobs.all())
    assert verdict.is_whole


def test_bytes_that_are_absent_by_design_are_no_damage(store: Store) -> None:
    blob(store, 1).unlink()
    assert kinds(verify(store)) == ["lacking"]
    result = store.actions.known(key_of("r1"))
    assert result is not None
    store.actions.put(key_of("r1"), result, may_lack=True)
    assert verify(store, repair=True).findings == []
    assert store.actions.known(key_of("r1")) == result
    store.blobs.path(result.output).unlink()
    assert kinds(verify(store)) == ["lacking"]


def test_an_empty_store_is_whole(tmp_path: Path) -> None:
    assert verify(Store(tmp_path / "new"), repair=True).is_whole


@pytest.mark.parametrize("kind", ["damaged", "truncated", "missing", "unreadable", "cut", "misfiled"])
def test_repair_makes_a_miss_of_damage_and_of_nothing_else(store: Store, kind: str) -> None:
    spoil(store, kind)
    found = verify(store)
    assert not found.is_whole
    assert store.actions.get(key_of("r1")) is not None
    repaired = verify(store, repair=True)
    assert repaired.is_whole
    assert all(finding.repaired for finding in repaired.findings)
    again = verify(store)
    assert again.findings == []
    assert store.actions.get(key_of("r0" if kind != "misfiled" else "other")) is None
    assert [store.actions.get(key_of(f"r{n}")) is not None for n in range(1, 5)] == [True] * 4


def spoil(store: Store, kind: str) -> None:
    """Damage the files of the first result."""
    if kind == "damaged":
        harm(blob(store, 0), b"z" * 100)
    elif kind == "truncated":
        harm(blob(store, 0), b"0" * 50)
    elif kind == "missing":
        blob(store, 0).unlink()
    elif kind == "unreadable":
        harm(entry(store, key_of("r0")), b"\0" * 300)
    elif kind == "cut":
        # Cut before its last line.
        whole = entry(store, key_of("r0")).read_bytes()
        harm(entry(store, key_of("r0")), whole[: whole.rindex(b"\n")])
    else:
        other = entry(store, key_of("other"))
        other.parent.mkdir(parents=True, exist_ok=True)
        other.write_bytes(entry(store, key_of("r1")).read_bytes())


def test_findings_say_what_is_wrong(store: Store) -> None:
    harm(blob(store, 0), b"z" * 100)
    harm(blob(store, 1), b"1" * 50)
    blob(store, 2).unlink()
    harm(entry(store, key_of("r3")), b"\xff")
    said = {(found.kind, found.name): found.detail for found in verify(store).findings}
    for number in (0, 1):
        blob(store, number).chmod(0o444)
    assert said == {
        ("damaged", digest.of_bytes(b"0" * 100)): "its bytes do not match its digest",
        ("truncated", digest.of_bytes(b"1" * 100)): "50 of 100 bytes",
        ("lacking", key_of("r1")): "1 of 3 blobs are not there",
        ("lacking", key_of("r2")): "1 of 3 blobs are not there",
        ("unreadable", key_of("r3")): "it is not a result, or belongs to another key",
    }


def test_fast_finds_sizes_but_no_bytes(store: Store) -> None:
    harm(blob(store, 0), b"z" * 100)
    harm(blob(store, 1), b"1" * 50)
    for number in (0, 1):
        blob(store, number).chmod(0o444)
    assert kinds(verify(store, fast=True)) == ["lacking", "truncated"]


def test_a_good_blob_is_not_set_aside_because_a_result_is_wrong_about_its_size(store: Store) -> None:
    whole = entry(store, key_of("r0")).read_bytes()
    harm(entry(store, key_of("r0")), whole.replace(b",100]", b",101]", 1))
    for fast in (True, False):
        assert kinds(verify(store, fast=fast)) == ["lacking"]
    verify(store, repair=True)
    assert store.blobs.get(digest.of_bytes(b"0" * 100)) == b"0" * 100


def test_damaged_blobs_are_set_aside_not_lost(store: Store) -> None:
    harm(blob(store, 0), b"z" * 100)
    verify(store, repair=True)
    assert (store.local / "quarantine" / digest.of_bytes(b"0" * 100)).read_bytes() == b"z" * 100


def test_leftovers_of_the_dead_are_removed_and_those_of_now_are_not(store: Store) -> None:
    workshop = store.blobs.root / ".tmp"
    dead, living = workshop / ".tmp-dead-1-1", workshop / ".tmp-living-1-1"
    for path in (dead, living):
        path.write_bytes(b"half")
    folder = store.blobs.root / ".tmp-made-aside"
    folder.mkdir()
    for path in (dead, folder):
        age(path, time.time() - 90_000)
    assert kinds(verify(store)) == ["leftover", "leftover"]
    assert all(finding.repaired for finding in verify(store, repair=True).findings)
    assert (dead.exists(), folder.exists(), living.exists()) == (False, False, True)


def test_progress_is_told(store: Store) -> None:
    told: list[tuple[int, int]] = []
    verify(store, progress=lambda count, size: told.append((count, size)))
    assert told
    assert told[0][0] >= 1


def test_a_store_that_may_only_be_read_is_verified_but_not_repaired(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert verify(store).is_whole
    with pytest.raises(StoreError, match="read-only and cannot be repaired") as caught:
        verify(store, repair=True)
    assert caught.value.code == "DXB-S402"
