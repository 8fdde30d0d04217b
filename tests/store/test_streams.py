"""A store as artifacts see it."""

from __future__ import annotations

from pathlib import Path

import pytest

from dextera_build.store.store import Store


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "store")


def test_a_writer_notes_what_is_in_the_store_now(store: Store, tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"a file")
    there = store.blobs.put(b"there")
    writer = store.writer
    put, (file, _) = writer(b"put"), writer.file(tmp_path / "file")
    assert writer.has(there, 5)
    assert not writer.has(there, 6)
    assert not writer.has("0" * 64, 1)
    assert writer.sizes == {put: 3, file: 6, there: 5}
    assert store.writer.sizes == {}
