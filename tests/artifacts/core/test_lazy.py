"""Collections and folders from a store: nothing is read until it is used, and what is used is the same."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build import digest
from dextera_build.artifacts.base import Collection, File, Folder
from dextera_build.artifacts.core.identity import spelled
from dextera_build.artifacts.core.lazy import Lazy
from dextera_build.artifacts.tasks.trials import Trials
from dextera_build.errors import ArtifactError


class Store:
    """Blobs in memory, with the methods of a store, that notes what is read."""

    def __init__(self) -> None:
        self.blobs: dict[str, bytes] = {}
        self.read: list[str] = []

    def put(self, data: bytes) -> str:
        key = digest.of_bytes(data)
        self.blobs[key] = data
        return key

    def __call__(self, key: str) -> bytes:
        self.read.append(key)
        return self.blobs[key]

    def place(self, key: str, target: Path) -> None:
        target.write_bytes(self.blobs[key])

    def path(self, key: str) -> Path:
        raise AssertionError("not needed here")


FILES = {"a.txt": b"first", "sub/b.bin": b"second", "sub/c.bin": b""}


def test_a_folder_reads_a_file_when_it_is_used():
    store = Store()
    key = Folder(files=FILES).encode(store.put)
    folder = Folder.decode(key, store)
    assert sorted(folder.files) == sorted(FILES)
    assert "a.txt" in folder.files
    assert len(folder.files) == 3
    assert list(folder.facts()) == ["3 files (a.txt, sub/b.bin, sub/c.bin)", "11 bytes"]
    assert store.read == [key]
    assert folder.files["sub/b.bin"] == b"second"
    assert store.read == [key, digest.of_bytes(b"second")]
    assert folder == Folder(files=FILES)
    assert Folder(files=FILES) == folder


def test_a_collection_loads_an_item_when_it_is_used():
    store = Store()
    items = {label: File(data=label.encode()) for label in ("one", "two")}
    key = Collection[File](items=items).encode(store.put)
    found = Collection[File].decode(key, store)
    assert list(found.items) == ["one", "two"]
    assert store.read == [key]
    assert found.items["two"].data == b"two"
    assert len(store.read) == 3  # its header and its bytes
    assert found.items["two"] is found.items["two"]
    assert found == Collection[File](items=items)
    assert list(found.facts()) == ["2 File (one, two)"]
    assert found.encode(store.put) == key


def test_items_of_another_type_are_refused_when_they_are_used():
    store = Store()
    key = Collection[File](items={"one": File(data=b"1")}).encode(store.put)
    found = Collection[Trials].decode(key, store)
    with pytest.raises(Exception, match="a Trials is needed here, but a File came"):
        found.items["one"]


@pytest.mark.parametrize(
    "header", [b"[]", b"{}", b'{"artifact": "File"}', b'{"artifact": "File", "fields": 3}', b"\xff"]
)
def test_an_item_with_a_malformed_header_is_refused_when_it_is_used(header: bytes) -> None:
    store = Store()
    items = {"$map": {"one": {"$ref": store.put(header)}}}
    key = store.put(digest.canonical({"artifact": spelled(Collection[File]), "fields": {"items": items}}))
    found = Collection[File].decode(key, store)
    with pytest.raises(ArtifactError) as caught:
        found.items["one"]
    assert caught.value.code in {"DXB-A102", "DXB-A111"}


def test_a_folder_on_disk_is_stored_in_pieces_and_exported(tmp_path):
    Folder(files=FILES).export(tmp_path / "in", "")
    folder, store = Folder.of(tmp_path / "in"), Store()
    assert dict(folder.files) == FILES
    assert folder.encode(store.put) == Folder(files=FILES).encode(store.put)
    written = Folder.decode(folder.encode(store.put), store).export(tmp_path / "out", "")
    assert {path.relative_to(tmp_path / "out").as_posix(): path.read_bytes() for path in written} == FILES
    pieces: list[Path] = []

    class Put:
        """A store that takes files."""

        def __call__(self, data: bytes) -> str:
            return store.put(data)

        def file(self, path: Path) -> tuple[str, int]:
            pieces.append(path)
            return store.put(path.read_bytes()), path.stat().st_size

    assert folder.encode(Put()) == folder.encode(store.put)
    assert sorted(path.name for path in pieces) == ["a.txt", "b.bin", "c.bin"]


@given(st.dictionaries(st.text(max_size=3), st.integers(), max_size=5))
def test_it_is_used_like_the_dictionary_that_it_stands_for(plain: dict[str, int]) -> None:
    def lazy() -> Any:
        return Lazy({key: str(value) for key, value in plain.items()}, int, keep=False)

    assert lazy() == plain
    assert plain == lazy()
    assert lazy() == lazy()
    assert dict(lazy()) == {**lazy()} == plain
    assert list(lazy()) == list(lazy().keys()) == list(plain)
    assert list(lazy().values()) == list(plain.values())
    assert list(lazy().items()) == list(plain.items())
    assert lazy() | {"new": 1} == plain | {"new": 1}
    assert {"new": 1} | lazy() == {"new": 1} | plain
    assert lazy().copy() == copy.copy(lazy()) == copy.deepcopy(lazy()) == pickle.loads(pickle.dumps(lazy())) == plain
    assert [lazy().get(key) for key in [*plain, "none of them"]] == [*plain.values(), None]
    assert lazy() != {**plain, "new": 1}
    assert bool(lazy()) == bool(plain)
    assert sorted(lazy(), key=str) == sorted(plain, key=str)


def test_it_does_not_change():
    lazy: Any = Lazy({"a": "1"}, int, keep=True)
    for change in (lambda: lazy.update(a=2), lambda: lazy.pop("a"), lambda: lazy.__setitem__("a", 2)):
        with pytest.raises(TypeError, match="do not change"):
            change()
    assert repr(lazy) == "Lazy(a)"
    with pytest.raises(KeyError):
        lazy["b"]
