"""Blobs: a read returns the stored bytes, or fails."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from dextera_build import digest
from dextera_build.errors import StoreError
from dextera_build.store.blobs import Blobs, MissingBlob


@pytest.fixture
def blobs(tmp_path: Path) -> Blobs:
    return Blobs(tmp_path / "cas")


@pytest.mark.parametrize("size", [0, 1, (1 << 14) - 1, 1 << 14, (1 << 14) + 1, 3_000_000])
def test_what_goes_in_comes_out(blobs: Blobs, tmp_path: Path, size: int) -> None:
    data = os.urandom(size)
    key = blobs.put(data)
    assert key == digest.of_bytes(data)
    assert blobs.get(key) == data
    assert blobs.has(key)
    assert blobs.size(key) == len(data)
    assert blobs.path(key) == tmp_path / "cas" / key[:2] / key[2:]
    assert stat.S_IMODE(blobs.path(key).stat().st_mode) == 0o444


@pytest.mark.parametrize("size", [0, 3_000_000])
def test_a_file_goes_in_as_its_bytes_do(blobs: Blobs, tmp_path: Path, size: int) -> None:
    data, path = os.urandom(size), tmp_path / "file"
    path.write_bytes(data)
    assert blobs.put_file(path) == (digest.of_bytes(data), len(data))
    assert blobs.get(digest.of_bytes(data)) == data
    path.write_bytes(b"changed")
    assert blobs.get(digest.of_bytes(data)) == data


def test_a_good_blob_is_not_written_again(blobs: Blobs) -> None:
    key = blobs.put(b"once")
    before = blobs.path(key).stat()
    blobs.put(b"once")
    assert blobs.path(key).stat().st_ino == before.st_ino


def test_a_missing_blob_is_named(blobs: Blobs) -> None:
    key = digest.of_bytes(b"never")
    assert not blobs.has(key)
    assert blobs.size(key) is None
    with pytest.raises(MissingBlob) as caught:
        blobs.get(key)
    assert caught.value.message == f"blob `{key[:12]}` cannot be read: it is not there"
    assert caught.value.facts == {"digest": key}


def test_a_damaged_blob_is_set_aside_and_can_come_back(blobs: Blobs, tmp_path: Path) -> None:
    key = blobs.put(b"good")
    blobs.path(key).chmod(0o644)
    blobs.path(key).write_bytes(b"evil")
    with pytest.raises(MissingBlob, match="damaged bytes, moved to quarantine"):
        blobs.get(key)
    assert not blobs.has(key)
    assert (tmp_path / "local" / "quarantine" / key).read_bytes() == b"evil"
    blobs.put(b"good")
    assert blobs.get(key) == b"good"


def test_a_blob_that_was_cut_short_is_replaced(blobs: Blobs) -> None:
    key = blobs.put(b"whole")
    blobs.path(key).chmod(0o644)
    blobs.path(key).write_bytes(b"")
    blobs.put(b"whole")
    assert blobs.get(key) == b"whole"


@pytest.mark.parametrize("name", ["", "../../etc/passwd", "A" * 64, "0" * 63, "g" * 64])
def test_only_digests_are_taken(blobs: Blobs, name: str) -> None:
    with pytest.raises(StoreError, match="is not a SHA-256 digest"):
        blobs.get(name)


def test_all_lists_every_blob_and_no_unfinished_file(blobs: Blobs, tmp_path: Path) -> None:
    keys = sorted(blobs.put(bytes([n]) * n) for n in range(20))
    (tmp_path / "cas" / ".tmp").mkdir(exist_ok=True)
    (tmp_path / "cas" / ".tmp" / ".tmp-left-over").write_bytes(b"half")
    assert [key for key, _ in blobs.all()] == keys
    assert sum(size for _, size in blobs.all()) == sum(range(20))
    assert list(Blobs(tmp_path / "nowhere").all()) == []


def test_an_interrupted_write_leaves_nothing(blobs: Blobs, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def interrupt(source: str, target: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", interrupt)
    with pytest.raises(KeyboardInterrupt):
        blobs.put(b"never")
    assert [path for path in (tmp_path / "cas").rglob("*") if path.is_file()] == []
