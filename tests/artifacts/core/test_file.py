"""Files and folders: content that stays on the disk until it is asked for, and goes to the disk in pieces."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from dextera_build import digest
from dextera_build.artifacts.base import Artifact, File, Folder
from dextera_build.artifacts.core import content
from dextera_build.errors import ArtifactError, StoreError
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.store import Store

LARGE = b"0123456789abcdef" * (content.SMALL // 16 + 1)


class Pair(Artifact):
    """Two files."""

    one: File
    """A file."""
    two: File
    """Another."""


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "store")


@pytest.fixture
def no_bytes(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """No large blob may be held in memory."""
    get, put = store.blobs.get, store.blobs.put

    def small_only(digest: str) -> bytes:
        data = get(digest)
        assert len(data) <= content.SMALL
        return data

    def put_small_only(data: bytes) -> str:
        assert len(data) <= content.SMALL
        return put(data)

    monkeypatch.setattr(store.blobs, "get", small_only)
    monkeypatch.setattr(store.blobs, "put", put_small_only)


@pytest.mark.parametrize("data", [b"", b"small", LARGE])
def test_a_file_of_a_path_is_the_file_of_its_bytes(store: Store, tmp_path: Path, data: bytes) -> None:
    (tmp_path / "f").write_bytes(data)
    made = File.of(tmp_path / "f")
    assert made == File(data=data)
    assert made.encode(store.writer) == File(data=data).encode(store.blobs.put)
    assert File.of(tmp_path / "f").encode(digest.of_bytes) == File(data=data).encode(digest.of_bytes)


@pytest.mark.usefixtures("no_bytes")
def test_large_content_is_never_in_memory(store: Store, tmp_path: Path) -> None:
    (tmp_path / "f").write_bytes(LARGE)
    key = Pair(one=File.of(tmp_path / "f"), two=File(data=b"small")).encode(store.writer)
    (tmp_path / "f").unlink()
    pair = Pair.decode(key, store.reader)
    assert pair.one.path(tmp_path).stat().st_size == len(LARGE)
    with pair.one.open() as stream:
        assert stream.read(16) == LARGE[:16]
    assert pair.encode(store.writer) == key
    main, *_ = pair.one.export(tmp_path / "out", "one")
    assert main.read_bytes() == LARGE
    assert main.stat().st_mode & 0o200  # one's own
    assert "data" not in pair.one.__dict__
    (main,) = File.restore(pair.one.encode(store.writer), store.reader, tmp_path / "again", "one")
    assert main.read_bytes() == LARGE


def test_what_is_asked_for_is_read(store: Store) -> None:
    key = File(data=LARGE).encode(store.writer)
    assert File.decode(key, store.reader).data == LARGE
    assert File.decode(key, store.blobs.get).data == LARGE  # what gets bytes alone will do


def test_damaged_content_is_not_opened(store: Store, tmp_path: Path) -> None:
    key = File(data=LARGE).encode(store.writer)
    blob = store.blobs.path(digest.of_bytes(LARGE))
    blob.chmod(0o644)
    blob.write_bytes(bytes(len(LARGE)))
    with pytest.raises(MissingBlob):
        File.decode(key, store.reader).open()
    with pytest.raises(MissingBlob):
        File.decode(key, store.reader).place(tmp_path / "out")


def test_a_small_file_has_a_path_too(tmp_path: Path) -> None:
    path = File(data=b"small").path(tmp_path)
    assert path.read_bytes() == b"small"
    assert path.parent == tmp_path
    with File(data=b"small").open() as stream:
        assert stream.read() == b"small"


TREE = {"b/deep/two.txt": b"2", "a.txt": b"1", "b/one.txt": LARGE}


@pytest.mark.usefixtures("no_bytes")
def test_a_tree_is_restored_file_by_file(store: Store, tmp_path: Path) -> None:
    for name, data in TREE.items():
        path = tmp_path / "tree" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    key = store.leaves.digest_leaf(tmp_path / "tree")
    restored = Folder.restore(key, store.reader, tmp_path / "out", "stem")
    assert [path.relative_to(tmp_path / "out").as_posix() for path in restored] == [
        "a.txt",
        "b/one.txt",
        "b/deep/two.txt",
    ]
    assert {name: (tmp_path / "out" / name).read_bytes() for name in TREE} == TREE


def test_restoring_and_exporting_a_tree_are_one(store: Store, tmp_path: Path) -> None:
    folder = Folder(files=TREE)
    key = folder.encode(store.writer)
    one, two = tmp_path / "one", tmp_path / "two"
    exported = [path.relative_to(one) for path in folder.export(one, "s")]
    assert [path.relative_to(two) for path in Folder.restore(key, store.reader, two, "s")] == exported
    assert [path.relative_to(two) for path in Folder.restore(key, store.blobs.get, two, "s")] == exported


@pytest.mark.parametrize("name", ["../out.txt", "a/../../out.txt", "/out.txt", "a\0b"])
def test_a_name_that_is_no_path_below_writes_nothing(store: Store, tmp_path: Path, name: str) -> None:
    header = {"artifact": "Folder", "fields": {"files": {"$map": {name: {"$bytes": [store.blobs.put(b"x"), 1]}}}}}
    key = store.blobs.put(json.dumps(header).encode())
    for attempt in (
        lambda: Folder.restore(key, store.reader, tmp_path / "deep" / "out", "s"),
        lambda: Folder.decode(key, store.reader).export(tmp_path / "deep" / "out", "s"),
    ):
        with pytest.raises(StoreError, match="cannot be written below") as caught:
            attempt()
        assert caught.value.code == "DXB-S404"
    assert not list(tmp_path.rglob("out.txt"))


def test_a_file_that_was_read_is_like_one_that_was_made(store: Store) -> None:
    made = File(data=b"content")
    key = made.encode(store.writer)
    read = File.decode(key, store.reader)
    assert read == made
    assert repr(read) == repr(made)
    assert read.model_dump() == made.model_dump()
    assert read.model_fields_set == made.model_fields_set
    assert read.model_copy(update={"data": b"other"}) == File(data=b"other")
    assert (read.encode(store.writer), hash(read)) == (key, hash(made))
    with pytest.raises(ValueError, match="frozen"):
        read.data = b"other"


def test_a_header_that_is_spelled_in_another_way_is_read_too(store: Store) -> None:
    blob = store.blobs.put(b"content")
    key = store.blobs.put(
        json.dumps({"fields": {"data": {"$bytes": [blob, 7]}}, "artifact": "File"}, indent=1).encode()
    )
    assert File.decode(key, store.reader) == File(data=b"content")


def test_who_derives_from_it_is_read_as_he_declares(store: Store) -> None:
    class Named(File):
        title: str

    key = Named(data=b"content", title="a").encode(store.writer)
    assert Named.decode(key, store.reader) == Named(data=b"content", title="a")
    assert Named.decode(key, store.reader).title == "a"
    plain = File(data=b"content").encode(store.writer)
    with pytest.raises(ArtifactError, match=r"a tests\.Named is needed here"):
        Named.decode(plain, store.reader)
