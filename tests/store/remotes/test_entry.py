"""Entries that come from elsewhere: what dxb wrote passes, and nothing else."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dextera_build.store.actions import ActionResult
from dextera_build.store.reapi import OutputFile, decode, encode
from dextera_build.store.remotes import entry as entries
from dextera_build.store.remotes.remote import Digest
from dextera_build.store.store import Store
from tests.engine.tiny import call, graph, run

HEX = "ab" * 32


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, Digest]:
    store = Store(tmp_path_factory.mktemp("store"))
    result, _ = run(graph(call("a", "blob")), store)
    key = result.nodes["a"].key
    assert key is not None
    found = store.actions.message(key)
    assert found is not None
    return found[0], Digest(key, store.blobs.size(key) or 0)


def accepted(message: bytes, key: Digest) -> ActionResult | None:
    entry = entries.read(message, key)
    return entries.result(entry, entry.inline) if entry is not None else None


def changed(message: bytes, **fields: Any) -> bytes:
    """The message with another `result.json`, rightly named."""
    files = decode(message)
    raw = json.loads(files[-1].contents) | fields
    data = json.dumps({name: value for name, value in raw.items() if value is not ...}).encode()
    return encode([*files[:-1], OutputFile("result.json", hashlib.sha256(data).hexdigest(), len(data), data)])


def test_what_dxb_wrote_passes(built: tuple[bytes, Digest]) -> None:
    assert accepted(*built) is not None
    assert accepted(changed(built[0], line="another"), built[1]) is not None


@settings(deadline=None)
@given(data=st.binary(max_size=400))
def test_random_bytes_are_no_entry(data: bytes) -> None:
    assert entries.read(data, Digest(HEX, 3)) is None


@settings(deadline=None)
@given(data=st.data())
def test_a_changed_byte_is_no_harm(built: tuple[bytes, Digest], data: st.DataObject) -> None:
    message, key = built
    place = data.draw(st.integers(0, len(message) - 1))
    harmed = bytearray(message)
    harmed[place] ^= data.draw(st.integers(1, 255))
    cut = bytes(harmed[: data.draw(st.integers(place, len(message)))])
    for candidate in (bytes(harmed), cut):
        found = accepted(candidate, key)
        # A changed name of a blob in the closure has the right form; its bytes will not come.
        assert found is None or found.key_document == key.hash


@pytest.mark.parametrize(
    "fields",
    [
        {"line": 7},
        {"line": ...},
        {"more": 1},
        {"seconds": "1"},
        {"seconds": float("inf")},
        {"seconds": float("nan")},
        {"seconds": True},
        {"output": HEX},
        {"output": "../../etc/passwd"},
        {"key_document": HEX},
        {"log": HEX},
        {"log": 5},
        {"previews": [["a", HEX]]},
        {"previews": [["a"]]},
        {"previews": {}},
        {"metrics": {"m": [float("nan"), ""]}},
        {"metrics": {"m": 1}},
        {"metrics": []},
    ],
)
def test_a_result_of_another_form_is_refused(built: tuple[bytes, Digest], fields: dict[str, Any]) -> None:
    assert accepted(changed(built[0], **fields), built[1]) is None


def files_of(message: bytes) -> list[OutputFile]:
    return decode(message)


@pytest.mark.parametrize(
    "change",
    [
        lambda files: files[1:],
        lambda files: files[:-1],
        lambda files: [*files[:-2], files[-1]],
        lambda files: [files[0], *files],
        lambda files: [*files, files[0]],
        lambda files: [OutputFile("../../evil", HEX, 1), *files],
        lambda files: [OutputFile("/etc/passwd", HEX, 1), *files],
        lambda files: [OutputFile("closure/" + "cd" * 32, HEX, 1), *files],
        lambda files: [OutputFile("previews/0.png/../../x", HEX, 1), *files],
        lambda files: [OutputFile("closure/" + HEX, HEX, 1 << 60), *files],
        lambda files: [
            *files[:-1],
            OutputFile("result.json", files[-1].digest, files[-1].size + 1, files[-1].contents),
        ],
        lambda files: [*files[:-1], OutputFile("result.json", files[-1].digest, 1 << 40)],
    ],
)
def test_an_entry_of_another_form_is_refused(built: tuple[bytes, Digest], change: Any) -> None:
    message, key = built
    assert accepted(encode(change(files_of(message))), key) is None


def test_the_entry_of_another_key_is_refused(built: tuple[bytes, Digest]) -> None:
    message, key = built
    assert entries.read(message, Digest(HEX, key.size)) is None
    assert entries.read(message, Digest(key.hash, key.size + 1)) is None


def test_json_without_end_is_refused(built: tuple[bytes, Digest]) -> None:
    message, key = built
    deep = b"[" * 200_000
    files = [*decode(message)[:-1], OutputFile("result.json", hashlib.sha256(deep).hexdigest(), len(deep), deep)]
    assert accepted(encode(files), key) is None


def test_an_entry_that_hides_a_blob_is_a_miss(tmp_path: Path) -> None:
    from dextera_build.store.remotes.directory import Directory
    from dextera_build.store.transfer import Transfer

    store, share = Store(tmp_path / "store"), Directory(tmp_path / "share")
    result, _ = run(graph(call("a", "blob")), store)
    key = result.nodes["a"].key or ""
    Transfer(store).send(share, key)
    whole = store.actions.message(key)
    assert whole is not None
    name = Digest(key, store.blobs.size(key) or 0)
    share.put_action(name, encode([file for file in whole[1] if not file.path.startswith("closure/")]))
    other = Store(tmp_path / "other")
    assert Transfer(other).fetch(share, name) is None
    assert other.actions.get(key) is None
    share.put_action(name, whole[0])
    assert Transfer(other).fetch(share, name) is not None


def test_a_folder_that_leads_out_of_its_folder_is_a_miss(tmp_path: Path) -> None:
    from dextera_build import digest
    from dextera_build.store.remotes.directory import Directory
    from dextera_build.store.transfer import Transfer

    store, share = Store(tmp_path / "store"), tmp_path / "share"
    evil = store.blobs.put(b"evil")
    label = {"../../evil": {"$bytes": [evil, 4]}}
    output = store.blobs.put(digest.canonical({"artifact": "Folder", "fields": {"files": {"$map": label}}}))
    document = store.blobs.put(b"a key document")
    result = ActionResult(output, "", (), {}, 0.0, None, document)
    named = [
        OutputFile("output", output, store.blobs.size(output) or 0),
        OutputFile(f"closure/{evil}", evil, 4),
        OutputFile("key.json", document, 14),
        OutputFile("result.json", result.digest, len(result.document), result.document),
    ]
    shutil.copytree(tmp_path / "store" / "cas", share / "cas")
    key = Digest(document, 14)
    Directory(share).put_action(key, encode(named))
    other = Store(tmp_path / "other")
    assert Transfer(other).fetch(Directory(share), key) is None
    assert other.actions.get(key.hash) is None
