"""Untrusted entries: only those written by dxb are accepted."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dextera_build import digest
from dextera_build.gc.verify import verify
from dextera_build.remotes.folder import Directory
from dextera_build.remotes.transfer import Transfer
from dextera_build.store import entry as entries
from dextera_build.store.entry import ActionResult, Entry, File
from dextera_build.store.store import Store
from tests.engine.tiny import call, graph, run
from tests.store.stores import entry, forged

HEX = "ab" * 32


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    store = Store(tmp_path_factory.mktemp("store"))
    result, _ = run(graph(call("a", "blob")), store)
    return entry(store, result.nodes["a"].key or "").read_bytes()


def accepted(message: bytes) -> Entry | None:
    try:
        return entries.read(message)
    except ValueError:
        return None


def changed(message: bytes, **fields: Any) -> bytes:
    """The entry with another result, under its correct digest."""

    def other(made: bytes) -> bytes:
        raw = json.loads(made) | fields
        return json.dumps({name: value for name, value in raw.items() if value is not ...}).encode()

    return forged(message, result=other)


def test_what_dxb_wrote_passes(built: bytes) -> None:
    found = accepted(built)
    assert found is not None
    assert found.spell() == built
    assert accepted(changed(built, line="another")) is not None


@settings(deadline=None)
@given(data=st.binary(max_size=400))
def test_random_bytes_are_no_entry(data: bytes) -> None:
    assert accepted(data) is None


@settings(deadline=None)
@given(data=st.data())
def test_a_changed_byte_is_no_harm(built: bytes, data: st.DataObject) -> None:
    place = data.draw(st.integers(0, len(built) - 1))
    harmed = bytearray(built)
    harmed[place] ^= data.draw(st.integers(1, 255))
    cut = bytes(harmed[: data.draw(st.integers(place, len(built)))])
    whole = accepted(built)
    assert whole is not None
    for candidate in (bytes(harmed), cut):
        found = accepted(candidate)
        # A changed digest of a blob in the closure is well-formed, but names bytes that do not exist.
        assert found is None or found.result == whole.result


@pytest.mark.parametrize(
    "fields",
    [
        {"line": 7},
        {"line": ...},
        {"line": "\ud800"},
        {"metrics": {"\ud800": [1.0, ""]}},
        {"metrics": {"m": [1.0, "\ud800"]}},
        {"more": 1},
        {"seconds": "1"},
        {"seconds": float("inf")},
        {"seconds": float("nan")},
        {"seconds": True},
        {"output": HEX},
        {"output": "../../etc/passwd"},
        {"key_document": HEX},
        {"log": 5},
        {"previews": [["a"]]},
        {"previews": {}},
        {"metrics": {"m": [float("nan"), ""]}},
        {"metrics": {"m": 1}},
        {"metrics": []},
    ],
)
def test_a_result_of_another_form_is_refused(built: bytes, fields: dict[str, Any]) -> None:
    assert accepted(changed(built, **fields)) is None


@pytest.mark.parametrize(
    "change",
    [
        lambda files: [],
        lambda files: files[1:],
        lambda files: {},
        lambda files: [["../../evil", HEX, 1], *files],
        lambda files: [*files, ["../../evil", HEX, 1]],
        lambda files: [*files, ["blob", "../../evil", 1]],
        lambda files: [*files, ["blob", HEX.upper(), 1]],
        lambda files: [*files, ["blob", HEX, 1 << 60]],
        lambda files: [*files, ["blob", HEX, -1]],
        lambda files: [*files, ["blob", HEX, True]],
        lambda files: [*files, ["header", HEX, None]],
        lambda files: [files[0], *files],
        lambda files: [file for file in files if file[0] != "key"],
        lambda files: [*files, ["blob", HEX]],
        lambda files: [*files, ["blob", [HEX], 1]],
        lambda files: [[*files[0][:2], 1.0], *files[1:]],
    ],
)
def test_an_entry_of_another_form_is_refused(built: bytes, change: Any) -> None:
    assert accepted(forged(built, files=change)) is None


def test_another_end_is_refused(built: bytes) -> None:
    assert accepted(built + b" ") is None
    assert accepted(built.rsplit(b"\n", 1)[0]) is None


def test_json_without_end_is_refused(built: bytes) -> None:
    assert accepted(forged(built, result=lambda made: b"[" * 200_000)) is None
    assert accepted(b"[" * 200_000 + built) is None


def test_an_entry_that_hides_a_blob_is_a_miss(tmp_path: Path) -> None:
    store, share = Store(tmp_path / "store"), Directory(tmp_path / "share")
    result, _ = run(graph(call("a", "blob")), store)
    key = result.nodes["a"].key or ""
    Transfer(store).send(share, key)
    whole = entry(store, key).read_bytes()
    share.put_entry(key, forged(whole, files=lambda files: [file for file in files if file[0] != "blob"]))
    other = Store(tmp_path / "other")
    assert Transfer(other).fetch(share, key) is None
    assert other.actions.get(key) is None
    share.put_entry(key, whole)
    assert Transfer(other).fetch(share, key) is not None


def test_the_entry_of_another_key_is_a_miss(tmp_path: Path) -> None:
    store, share = Store(tmp_path / "store"), Directory(tmp_path / "share")
    result, _ = run(graph(call("a", "blob")), store)
    key = result.nodes["a"].key or ""
    Transfer(store).send(share, key)
    share.put_entry(HEX, entry(store, key).read_bytes())
    assert Transfer(Store(tmp_path / "other")).fetch(share, HEX) is None


def test_a_folder_that_leads_out_of_its_folder_is_a_miss(tmp_path: Path) -> None:
    store, share = Store(tmp_path / "store"), tmp_path / "share"
    evil = store.blobs.put(b"evil")
    label = {"../../evil": {"$bytes": [evil, 4]}}
    output = store.blobs.put(digest.canonical({"artifact": "Folder", "fields": {"files": {"$map": label}}}))
    document = store.blobs.put(b"{}")
    files = (File("output", output, store.blobs.size(output)), File("key", document, 2), File("blob", evil, 4))
    made = Entry(ActionResult(output, "", (), {}, 0.0, None, document), files)
    shutil.copytree(tmp_path / "store" / "cas", share / "cas")
    Directory(share).put_entry(document, made.spell())
    other = Store(tmp_path / "other")
    assert Transfer(other).fetch(Directory(share), document) is None
    assert other.actions.get(document) is None


@pytest.mark.parametrize("whole", [True, False])
def test_another_store_can_be_read_as_a_remote(tmp_path: Path, whole: bool) -> None:
    store, other = Store(tmp_path / "store"), Store(tmp_path / "other")
    result, _ = run(graph(call("a", "blob")), store)
    key = result.nodes["a"].key or ""
    fetched = Transfer(other).fetch(Directory(store.root), key, whole=whole)
    assert fetched is not None
    assert fetched.is_whole == whole
    assert other.actions.known(key) == store.actions.known(key)
    assert (entry(other, key).read_bytes() == entry(store, key).read_bytes()) == whole
    assert other.blobs.get(key) == store.blobs.get(key)
    assert verify(other).findings == []
