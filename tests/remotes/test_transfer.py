"""Uploads: blobs first, the entry last, nothing damaged; downloads: only missing blobs."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

import pytest

from dextera_build.remotes.breaker import Guarded
from dextera_build.remotes.folder import Directory
from dextera_build.remotes.remote import Digest, RemoteFault
from dextera_build.remotes.transfer import Transfer
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.store import Store
from tests.engine.tiny import call, graph, out, run


class Noted(Directory):
    """Records its requests in order."""

    def __init__(self, root: Path) -> None:
        super().__init__(root)
        self.log: list[str] = []
        self.fails = ""

    def _note(self, what: str) -> None:
        self.log.append(what)
        if what == self.fails:
            raise RemoteFault(self.address, "no luck")

    def has(self, digest: Digest) -> bool:
        self._note("has")
        return super().has(digest)

    def fetch(self, digest: Digest, take: Callable[[Iterator[bytes]], bool]) -> bool | None:
        self._note("fetch")
        return super().fetch(digest, take)

    def send(self, digest: Digest, file: BinaryIO) -> None:
        self._note("send")
        super().send(digest, file)

    def put_entry(self, key: str, message: bytes) -> None:
        self._note("put")
        super().put_entry(key, message)


@pytest.fixture
def built(tmp_path: Path) -> tuple[Store, list[str]]:
    store = Store(tmp_path / "store")
    result, _ = run(graph(call("a", "blob"), call("b", "blob", x=out("a"))), store)
    return store, [result.nodes[name].key or "" for name in ("a", "b")]


def test_blobs_go_first_and_the_entry_last(built: tuple[Store, list[str]], tmp_path: Path) -> None:
    store, (key, _) = built
    remote = Noted(tmp_path / "share")
    assert Transfer(store).send(remote, key) > 64
    assert sorted(remote.log[:-1]) == ["has", "has", "has", "send", "send", "send"]  # key document, header, its blob
    assert remote.log[-1] == "put"


@pytest.mark.parametrize("fails", ["has", "send", "put"])
def test_without_its_blobs_no_entry_is_published(built: tuple[Store, list[str]], tmp_path: Path, fails: str) -> None:
    store, (key, _) = built
    remote = Noted(tmp_path / "share")
    remote.fails = fails
    with pytest.raises(RemoteFault):
        Transfer(store).send(remote, key)
    assert Directory(tmp_path / "share").get_entry(key) is None


def test_what_is_there_is_not_sent_again(built: tuple[Store, list[str]], tmp_path: Path) -> None:
    store, (key, _) = built
    remote, transfer = Noted(tmp_path / "share"), Transfer(store)
    transfer.send(remote, key)
    assert transfer.send(remote, key) == 0
    assert Transfer(store).send(remote, key) == 0
    assert remote.log.count("send") == 3


def test_damage_here_is_not_spread(built: tuple[Store, list[str]], tmp_path: Path) -> None:
    store, (key, _) = built
    result = store.actions.get(key)
    assert result is not None
    file = store.blobs.path(result.output)
    data = file.read_bytes()
    file.chmod(0o644)
    file.write_bytes(data.replace(b"Text", b"Tent"))
    with pytest.raises(MissingBlob):
        Transfer(store).send(Directory(tmp_path / "share"), key)
    assert Directory(tmp_path / "share").get_entry(key) is None


def test_only_what_is_missing_comes(built: tuple[Store, list[str]], tmp_path: Path) -> None:
    store, keys = built
    remote = Noted(tmp_path / "share")
    for key in keys:
        Transfer(store).send(remote, key)
    other = Store(tmp_path / "other")
    blob = next(digest for digest, size in store.blobs.all() if size == 64)
    other.blobs.put(store.blobs.get(blob))
    remote.log.clear()
    for key in keys:
        assert Transfer(other).fetch(remote, key) is not None
    assert remote.log.count("fetch") == 5
    assert Transfer(other).fetch(remote, keys[0]) is not None
    assert remote.log.count("fetch") == 5


def test_what_came_damaged_is_sent_again(built: tuple[Store, list[str]], tmp_path: Path) -> None:
    store, (key, _) = built
    share = Directory(tmp_path / "share")
    Transfer(store).send(share, key)
    victim = next(path for path in (tmp_path / "share/cas").rglob("*") if path.is_file() and path.stat().st_size == 64)
    whole = victim.read_bytes()
    victim.chmod(0o644)
    victim.write_bytes(b"X" + whole[1:])
    other = Store(tmp_path / "other")
    transfer = Transfer(other)
    with pytest.raises(RemoteFault, match="does not match its digest"):
        transfer.fetch(share, key)
    run(graph(call("a", "blob")), other)
    assert transfer.send(share, key) == 64
    assert victim.read_bytes() == whole


def test_a_folder_in_place_of_a_file_is_a_miss_and_is_replaced(built: tuple[Store, list[str]], tmp_path: Path) -> None:
    store, (key, _) = built
    share = Directory(tmp_path / "share")
    Transfer(store).send(share, key)
    for path in [path for path in (tmp_path / "share").rglob("*") if path.is_file()]:
        data = path.read_bytes()
        path.unlink()
        (path / "within").mkdir(parents=True)
        assert Transfer(Store(tmp_path / path.name)).fetch(share, key) is None
        Transfer(store).send(share, key)
        assert path.read_bytes() == data
    assert Transfer(Store(tmp_path / "other")).fetch(share, key) is not None


def test_a_result_that_is_not_here_cannot_be_sent(tmp_path: Path) -> None:
    with pytest.raises(MissingBlob, match="no whole result under this key"):
        Transfer(Store(tmp_path / "store")).send(Directory(tmp_path / "share"), "ab" * 32)


@pytest.mark.parametrize(("refused", "tries", "doing"), [(True, 1, "read"), (False, 2, "both")])
def test_a_fault_is_tried_once_more_and_a_refusal_is_not(tmp_path: Path, refused: bool, tries: int, doing: str) -> None:
    calls: list[str] = []

    class Failing(Directory):
        def get_entry(self, key: str) -> bytes | None:
            calls.append("get")
            raise RemoteFault("x", "no", refused=refused)

    guarded = Guarded("x", "x", lambda: Failing(tmp_path))
    for _ in range(3):
        with pytest.raises(RemoteFault, match="no"):
            guarded.get_entry("ab" * 32)
    assert len(calls) == tries
    assert not guarded.may("read")
    assert guarded.may("write") == refused
    assert [(notice.doing, notice.reason) for notice in guarded.given_up] == [(doing, "no")]


def test_a_fault_that_does_not_come_again_is_forgotten(tmp_path: Path) -> None:
    calls: list[str] = []

    class Stumbling(Directory):
        def get_entry(self, key: str) -> bytes | None:
            calls.append("get")
            if len(calls) % 2:
                raise RemoteFault("x", "no")
            return None

    guarded = Guarded("x", "x", lambda: Stumbling(tmp_path))
    assert [guarded.get_entry("ab" * 32) for _ in range(4)] == [None] * 4
    assert guarded.given_up == []


def test_a_remote_is_connected_once_however_many_ask(tmp_path: Path) -> None:
    opened: list[int] = []

    def opener() -> Directory:
        opened.append(1)
        return Directory(tmp_path)

    guarded = Guarded("x", "x", opener)
    threads = [threading.Thread(target=lambda: guarded.get_entry("ab" * 32)) for _ in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert opened == [1]
