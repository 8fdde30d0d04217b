"""Folders in which calls save their progress."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from dextera_build import digest
from dextera_build.store.store import Store

KEY, OTHER = digest.of_bytes(b"key"), digest.of_bytes(b"other")


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "store")


def fill(store: Store, key: str, size: int = 5) -> Path:
    folder = store.keep.path(key)
    (folder / "inner").mkdir(parents=True)
    (folder / "inner" / "state").write_bytes(b"x" * size)
    return folder


def test_each_key_has_a_folder_of_its_own_on_this_machine(store: Store) -> None:
    folder = fill(store, KEY)
    assert folder.is_relative_to(store.local)
    assert not store.keep.path(OTHER).exists()
    assert store.size()["keep"] == (1, 5)


def test_drop_leaves_nothing_and_other_keys_alone(store: Store) -> None:
    fill(store, KEY)
    other = fill(store, OTHER)
    store.keep.drop(KEY)
    store.keep.drop(KEY)
    assert [path.name for path in store.keep.root.iterdir()] == [OTHER]
    assert (other / "inner" / "state").exists()


def test_a_kill_in_the_middle_of_drop_leaves_no_half_folder(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = fill(store, KEY)

    def killed(*arguments: object, **more: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("shutil.rmtree", killed)
    with pytest.raises(KeyboardInterrupt):
        store.keep.drop(KEY)
    monkeypatch.undo()
    assert not folder.exists()
    assert list(store.keep.all()) == []


def test_drop_in_a_store_that_cannot_be_written_keeps_it(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = fill(store, KEY)

    def refuse(source: object, target: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "rename", refuse)
    store.keep.drop(KEY)
    assert folder.exists()
