"""Key documents that entries hold: no blobs of their own, and read as if they were."""

from __future__ import annotations

import os
import urllib.error
import urllib.request
from contextlib import suppress
from pathlib import Path
from threading import Thread

import pytest

from dextera_build import digest
from dextera_build.gc.choose import Limits
from dextera_build.gc.collect import collect
from dextera_build.gc.verify import verify
from dextera_build.remotes.folder import Directory
from dextera_build.remotes.server import CacheServer
from dextera_build.remotes.transfer import Transfer
from dextera_build.store import entry as entries
from dextera_build.store import headers
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store
from tests.store.stores import DAY, age_all, entry, harm, held, nobody

DOCUMENT = digest.canonical({"rule": "tiny", "options": {"value": "x" * 40}})
KEY = digest.of_bytes(DOCUMENT)


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "store")


def made(store: Store, key: str = KEY) -> ActionResult:
    content = store.blobs.put(b"content")
    output = store.blobs.put(headers.file_header(content, 7))
    return ActionResult(output, "a line", (), {"count": (3.0, "")}, 1.25, store.blobs.put(b"said"), key)


@pytest.fixture
def result(store: Store) -> ActionResult:
    """Published under `KEY`, with the key document in its entry."""
    found = made(store)
    store.actions.put(KEY, found, document=DOCUMENT)
    return found


def as_blob(store: Store) -> None:
    """Publish it with the key document as a blob."""
    store.blobs.put(DOCUMENT)
    store.actions.put(KEY, made(store))


def test_it_is_no_blob_and_is_read(store: Store, result: ActionResult) -> None:
    names = {name for name, _ in store.blobs.all()}
    assert names == {result.output, result.log, digest.of_bytes(b"content")}
    assert store.actions.get(KEY) == result
    assert {path.name for path in store.actions.files(KEY)} == {KEY[2:]} | {name[2:] for name in names}
    assert store.blobs.get(KEY) == DOCUMENT
    assert store.blobs.size(KEY) == len(DOCUMENT)
    assert store.blobs.has(KEY)
    with store.blobs.open(KEY) as file:
        assert file.read() == DOCUMENT
    assert store.actions.verify(KEY)


def test_an_entry_whose_key_document_is_a_blob_needs_that_blob(store: Store) -> None:
    as_blob(store)
    assert KEY in {name for name, _ in store.blobs.all()}
    assert store.actions.document(KEY) is None
    assert store.actions.get(KEY) == made(store)
    store.blobs.path(KEY).unlink()
    assert store.actions.get(KEY) is None
    with pytest.raises(MissingBlob):
        store.blobs.get(KEY)


def test_a_long_key_document_is_a_blob(store: Store) -> None:
    for size, names in ((entries.MOST_DOCUMENT, 0), (entries.MOST_DOCUMENT + 1, 1)):
        document = b"x" * size
        key = digest.of_bytes(document)
        before = len(list(store.blobs.all()))
        result = made(store, key)
        after = len(list(store.blobs.all()))
        store.actions.put(key, result, document=document)
        assert len(list(store.blobs.all())) == after + names, before
        assert store.actions.get(key) == result
        assert store.blobs.get(key) == document


@pytest.mark.parametrize("how", ["put", "bare"])
def test_an_entry_that_is_written_anew_keeps_what_it_held(store: Store, result: ActionResult, how: str) -> None:
    store.blobs.path(digest.of_bytes(b"content")).unlink()
    if how == "bare":
        store.actions.put(KEY, result, may_lack=True)
        assert store.actions.get(KEY) is None
        assert store.actions.known(KEY) == result
        assert store.blobs.get(KEY) == DOCUMENT
    store.blobs.put(b"content")
    if how == "put":
        store.actions.put(KEY, result)
    assert store.actions.get(KEY) == result
    assert store.blobs.get(KEY) == DOCUMENT
    assert verify(store).findings == []
    assert not store.blobs.path(KEY).exists()


def test_no_damage_of_an_entry_gives_another_document(store: Store, result: ActionResult) -> None:
    """Promise: a damaged part of an entry is a miss, and verification finds it."""
    path = entry(store, KEY)
    whole = path.read_bytes()
    parts = [DOCUMENT, result.document]
    within = {place for part in parts for place in range(whole.index(part), whole.index(part) + len(part))}
    for place in range(len(whole)):
        for data in (whole[:place], whole[:place] + bytes([whole[place] ^ (1 << place % 8)]) + whole[place + 1 :]):
            path.unlink(missing_ok=True)
            path.write_bytes(data)
            if place in within:
                assert [finding.name for finding in verify(store).findings] == [KEY], place
            assert store.actions.document(KEY) in (None, DOCUMENT), place
            with suppress(MissingBlob):
                assert store.blobs.get(KEY) == DOCUMENT, place
            assert store.actions.get(KEY) in (None, result), place
            if place in within:
                assert not path.exists()


def test_repair_drops_an_entry_with_a_damaged_part(store: Store, result: ActionResult) -> None:
    path = entry(store, KEY)
    harm(path, path.read_bytes().replace(b"xxx", b"xyx"))
    (found,) = verify(store, repair=True).findings
    assert (found.kind, found.name, found.repaired) == ("unreadable", KEY, True)
    assert store.actions.get(KEY) is None


def test_a_collection_takes_the_document_with_the_entry_and_not_before(store: Store, result: ActionResult) -> None:
    age_all(store, os.stat(store.root).st_mtime - 9 * DAY)
    assert collect(store, held(KEY), dry=False).gone == []
    assert store.blobs.get(KEY) == DOCUMENT
    assert store.actions.get(KEY) == result
    age_all(store, os.stat(store.root).st_mtime - 9 * DAY)
    collect(store, nobody, Limits(size=0), dry=False)
    assert not store.blobs.has(KEY)
    assert list(store.blobs.all()) == []


def test_who_uploads_gives_the_entry_as_it_is(store: Store, result: ActionResult, tmp_path: Path) -> None:
    share = Directory(tmp_path / "share")
    Transfer(store).send(share, KEY)
    assert share.get_entry(KEY) == entry(store, KEY).read_bytes()
    other = Store(tmp_path / "other")
    assert Transfer(other).fetch(share, KEY) is not None
    assert entry(other, KEY).read_bytes() == entry(store, KEY).read_bytes()
    assert other.actions.get(KEY) == result
    assert other.blobs.get(KEY) == DOCUMENT
    share.close()


@pytest.mark.parametrize("whole", [True, False])
def test_another_store_can_be_read_as_a_remote(store: Store, result: ActionResult, tmp_path: Path, whole: bool) -> None:
    other, share = Store(tmp_path / "other"), Directory(store.root)
    fetched = Transfer(other).fetch(share, KEY, whole=whole)
    assert fetched is not None
    assert fetched.is_whole == whole
    assert other.actions.known(KEY) == result
    assert other.blobs.get(KEY) == DOCUMENT
    assert verify(other).findings == []
    share.close()


def test_a_server_gives_the_document_and_the_entry_as_it_is(store: Store, result: ActionResult) -> None:
    with CacheServer(store, ("127.0.0.1", 0)) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        assert ask(f"{server.url}/cas/{KEY}") == DOCUMENT
        assert ask(f"{server.url}/ac/{KEY}") == entry(store, KEY).read_bytes()
        server.shutdown()


def ask(url: str) -> bytes | None:
    try:
        with urllib.request.urlopen(url, timeout=20) as answer:
            return bytes(answer.read())
    except urllib.error.HTTPError:
        return None
