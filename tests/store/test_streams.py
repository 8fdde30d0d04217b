"""What stands between a store and the values that are made from it."""

from __future__ import annotations

from pathlib import Path

import pytest

from dextera_build.store import streams
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.store import Store


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "store")


def test_small_blobs_that_came_by_are_read_once(store: Store) -> None:
    written, there = store.writer(b"written"), store.blobs.put(b"there")
    assert store.recent(there) == b"there"
    for digest in (written, there):
        store.blobs.path(digest).unlink()
    assert (store.recent(written), store.recent(there)) == (b"written", b"there")
    with pytest.raises(MissingBlob):
        store.reader(written)


def test_only_few_and_small_ones_stay_in_memory(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    large = b"x" * ((1 << 14) + 1)
    digest = store.writer(large)
    assert store.recent(digest) == large
    assert store.recent.known(digest) is None
    monkeypatch.setattr(streams, "_MOST_KNOWN", 2)
    first, second, third = (store.writer(b"%d" % number) for number in range(3))
    assert store.recent.known(first) is None
    assert (store.recent.known(second), store.recent.known(third)) == (b"1", b"2")


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
