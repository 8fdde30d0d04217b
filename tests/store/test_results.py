"""Entries of the action cache: which ones are hits, and that damage never turns one into a wrong result."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path

import pytest

from dextera_build import digest
from dextera_build.gc.collect import collect
from dextera_build.gc.verify import verify
from dextera_build.store import entry as entries
from dextera_build.store import headers as header
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.entry import ActionResult
from dextera_build.store.results import Found
from dextera_build.store.store import Store
from tests.store.stores import DAY, age, age_all, nobody

KEY = digest.of_bytes(b"{}")


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "store")


@pytest.fixture
def result(store: Store) -> ActionResult:
    """A collection of a file, with a preview and a log."""
    part = store.blobs.put(header.file_header(store.blobs.put(b"content"), 7))
    return ActionResult(
        output=store.blobs.put(header.collection_header({"a": part, "b": part})),
        line="1 hinge, 0–131°",
        previews=(("before", store.blobs.put(b"png")),),
        metrics={"error": (0.5, "mm"), "count": (3.0, "")},
        seconds=1.25,
        log=store.blobs.put(b"hello"),
        key_document=store.blobs.put(b"{}"),
    )


def headers_of(store: Store, result: ActionResult) -> set[str]:
    """The blobs that must be present for a result to be known."""
    below = store.actions.references.below(result.output)
    return {result.output, result.key_document, *(key for key, is_header in below.items() if is_header)}


def test_what_goes_in_comes_out(store: Store, result: ActionResult) -> None:
    assert store.actions.get(KEY) is None
    assert store.actions.put(KEY, result)
    assert store.actions.get(KEY) == result
    assert ActionResult.from_document(result.document) == result
    plain = ActionResult(result.output, "", (), {}, 0.0, None, result.key_document)
    store.actions.put(KEY, plain)
    assert store.actions.get(KEY) == plain


def test_an_entry_names_everything_that_it_needs(store: Store, result: ActionResult) -> None:
    store.actions.put(KEY, result)
    named = entries.read((store.root / "ac" / KEY[:2] / KEY[2:]).read_bytes()).files
    assert {file.digest for file in named} == {key for key, _ in store.blobs.all()}
    assert {file.role for file in named} == {"output", "header", "blob", "key", "beside"}
    assert all(file.size == store.blobs.size(file.digest) for file in named)


def test_an_entry_without_one_of_its_blobs_is_a_miss(store: Store, result: ActionResult) -> None:
    for key, _ in list(store.blobs.all()):
        store.actions.put(KEY, result)
        data = store.blobs.get(key)
        store.blobs.path(key).unlink()
        assert store.actions.get(KEY) is None
        store.blobs.put(data)
        assert store.actions.get(KEY) == result
        store.blobs.path(key).chmod(0o644)
        store.blobs.path(key).write_bytes(data + b"!")
        assert store.actions.get(KEY) is None
        assert not store.blobs.has(key)
        store.blobs.put(data)


def test_a_bare_result_is_known_and_no_hit(store: Store, result: ActionResult) -> None:
    content = digest.of_bytes(b"content")
    store.blobs.path(content).unlink()
    store.actions.put(KEY, result, may_lack=True)
    assert store.actions.get(KEY) is None
    assert store.actions.known(KEY) == result
    assert store.actions.find(KEY) == Found(result, False)
    found = store.actions.entry(KEY)
    assert found is not None
    assert found.is_bare
    assert all(store.blobs.size(file.digest) == file.size for file in found.files)
    assert [file.digest for file in found.files if file.size is None] == [content]
    assert found.refers == store.actions.references.below(result.output).keys()
    store.blobs.put(b"content")
    assert store.actions.find(KEY) == Found(result, True)
    found = store.actions.entry(KEY)
    assert found is not None
    assert not found.is_bare


def test_a_result_whose_bytes_were_lost_is_known_as_long_as_its_headers_are_there(
    store: Store, result: ActionResult
) -> None:
    headers = headers_of(store, result)
    for key, _ in list(store.blobs.all()):
        store.actions.put(KEY, result)
        data = store.blobs.get(key)
        store.blobs.path(key).unlink()
        assert store.actions.find(KEY) == (None if key in headers else Found(result, False))
        store.blobs.put(data)
        assert store.actions.find(KEY) == Found(result, True)


def test_a_header_that_is_not_there_cannot_be_noted(store: Store, result: ActionResult) -> None:
    for missing in headers_of(store, result):
        data = store.blobs.get(missing)
        store.blobs.path(missing).unlink()
        with pytest.raises(MissingBlob):
            store.actions.put(KEY, result, may_lack=True)
        store.blobs.put(data)


def test_what_is_not_in_the_store_cannot_be_published(store: Store, result: ActionResult) -> None:
    store.blobs.path(digest.of_bytes(b"content")).unlink()
    with pytest.raises(MissingBlob):
        store.actions.put(KEY, result)
    assert store.actions.get(KEY) is None


def test_a_number_that_is_not_finite_is_refused(store: Store, result: ActionResult) -> None:
    bad = ActionResult(result.output, "", (), {"x": (float("inf"), "")}, 0.0, None, result.key_document)
    with pytest.raises(ValueError, match="not JSON compliant"):
        store.actions.put(KEY, bad)


def test_an_entry_is_lines_of_canonical_json(store: Store, result: ActionResult) -> None:
    """Promise: an entry can be read without dxb."""
    store.actions.put(KEY, result)
    head, made = (store.root / "ac" / KEY[:2] / KEY[2:]).read_bytes().split(b"\n")
    assert json.loads(head) == {"files": json.loads(head)["files"], "result": digest.of_bytes(made)}
    assert ["beside", result.log, 5] in json.loads(head)["files"]
    assert json.loads(made)["line"] == "1 hinge, 0–131°"
    assert [digest.canonical(json.loads(line)) for line in (head, made)] == [head, made]


def test_an_entry_under_another_key_is_a_miss(store: Store, result: ActionResult) -> None:
    """Promise: swapped entries are never returned for each other's keys."""
    other = store.blobs.put(b"[]")
    store.actions.put(KEY, result)
    store.actions.put(other, replace(result, key_document=other, line="another"))
    one, two = (store.root / "ac" / key[:2] / key[2:] for key in (KEY, other))
    one.rename(one.with_name("x"))
    two.rename(one)
    one.with_name("x").rename(two)
    assert sorted((finding.kind, finding.name) for finding in verify(store).findings) == sorted(
        ("unreadable", key) for key in (KEY, other)
    )
    assert [store.actions.get(key) or store.actions.known(key) for key in (KEY, other)] == [None, None]


def test_a_folder_in_place_of_an_entry_or_a_blob_is_a_miss_and_is_set_aside(store: Store, result: ActionResult) -> None:
    store.actions.put(KEY, result)
    content = digest.of_bytes(b"content")
    for path in (store.root / "ac" / KEY[:2] / KEY[2:], store.blobs.path(content)):
        path.unlink()
        (path / "within").mkdir(parents=True)
        assert [finding.kind for finding in verify(store).findings if finding.kind != "leftover"]
        assert store.actions.get(KEY) is None
        assert store.blobs.put(b"content") == content
        store.actions.put(KEY, result)
        assert store.actions.get(KEY) == result
        assert store.blobs.get(content) == b"content"
    assert verify(store).is_whole


def test_a_collection_takes_folders_that_stand_where_results_and_blobs_should(
    store: Store, result: ActionResult
) -> None:
    store.actions.put(KEY, result)
    entry, blob = store.root / "ac" / KEY[:2] / KEY[2:], store.blobs.path(digest.of_bytes(b"content"))
    for path in (entry, blob):
        path.unlink()
        path.mkdir()
    age_all(store, time.time() - 9 * DAY)
    for path in (entry, blob):
        age(path, time.time() - 9 * DAY)
    collect(store, nobody, dry=False)
    assert not entry.exists()
    assert not blob.exists()


@pytest.mark.parametrize("data", [b"", b"\n", b"{}\n{}\n{}", b"\x12\x05ab", b"[" * 100_000, b"\xff" * 20])
def test_what_is_not_an_entry_is_a_miss_and_goes_with_the_next_collection(store: Store, data: bytes) -> None:
    """Promise: entries of other versions and foreign files are harmless."""
    with pytest.raises(ValueError, match=r"^"):
        entries.read(data)
    path = store.root / "ac" / KEY[:2] / KEY[2:]
    path.parent.mkdir(parents=True)
    path.write_bytes(data)
    assert [finding.kind for finding in verify(store).findings] == ["unreadable"]
    collect(store, nobody, dry=False)
    assert not path.exists()
    path.write_bytes(data)
    assert store.actions.get(KEY) is None


def test_every_flipped_bit_is_a_miss_or_harmless(store: Store, result: ActionResult) -> None:
    store.actions.put(KEY, result)
    path = store.root / "ac" / KEY[:2] / KEY[2:]
    whole, known = path.read_bytes(), {key for key, _ in store.blobs.all()}
    for place in range(len(whole)):
        path.unlink(missing_ok=True)
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 4]) + whole[place + 1 :])
        assert store.actions.known(KEY) in (None, result), place
        assert store.actions.get(KEY) in (None, result), place
        assert {key for key, _ in store.blobs.all()} == known


def test_every_cut_is_a_miss(store: Store, result: ActionResult) -> None:
    store.actions.put(KEY, result)
    path = store.root / "ac" / KEY[:2] / KEY[2:]
    whole = path.read_bytes()
    for end in range(len(whole)):
        path.unlink(missing_ok=True)
        path.write_bytes(whole[:end])
        assert store.actions.known(KEY) is None, end
        assert store.actions.get(KEY) is None, end
