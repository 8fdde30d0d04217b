"""Entries of the action cache: `ActionResult` messages that other programs can read."""

from __future__ import annotations

from pathlib import Path

import pytest

from dextera_build import digest
from dextera_build.store import header
from dextera_build.store.actions import ABSENT, ActionResult, Found
from dextera_build.store.cas import MissingBlob
from dextera_build.store.reapi import OutputFile, decode, encode
from dextera_build.store.store import Store

KEY = digest.of_bytes(b"key")


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


def test_what_goes_in_comes_out(store: Store, result: ActionResult) -> None:
    assert store.actions.get(KEY) is None
    assert store.actions.put(KEY, result) == result.digest
    assert store.actions.get(KEY) == result
    assert ActionResult.from_document(store.blobs.get(result.digest)) == result
    plain = ActionResult(result.output, "", (), {}, 0.0, None, result.key_document)
    store.actions.put(KEY, plain)
    assert store.actions.get(KEY) == plain


def test_an_entry_names_everything_that_it_needs(store: Store, result: ActionResult) -> None:
    store.actions.put(KEY, result)
    outputs = decode((store.root / "ac" / KEY[:2] / KEY[2:]).read_bytes())
    assert {file.digest for file in outputs} == {key for key, _ in store.blobs.all()}
    assert {file.path.split("/")[0] for file in outputs} == {
        "output",
        "closure",
        "previews",
        "log",
        "key.json",
        "result.json",
    }
    assert all(file.size == store.blobs.size(file.digest) for file in outputs)
    assert set(store.actions.files(KEY)) == {
        store.root / "ac" / KEY[:2] / KEY[2:],
        *(store.blobs.path(key) for key, _ in store.blobs.all()),
    }
    assert store.actions.files(digest.of_bytes(b"other")) == []


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


def test_sizes_that_are_known_give_the_same_entry(store: Store, result: ActionResult) -> None:
    looked = store.actions.spell(result)
    assert store.actions.spell(result, sizes=dict(store.blobs.all())) == looked
    assert store.actions.spell(result, sizes={result.output: store.blobs.size(result.output) or 0}) == looked


def test_a_bare_result_is_known_and_no_hit(store: Store, result: ActionResult) -> None:
    content = digest.of_bytes(b"content")
    store.blobs.path(content).unlink()
    store.actions.put_bare(KEY, result)
    assert store.actions.get(KEY) is None
    assert store.actions.known(KEY) == result
    assert store.actions.find(KEY) == Found(result, False)
    named = decode((store.root / "ac" / KEY[:2] / KEY[2:]).read_bytes())
    assert ABSENT in named
    assert all(file == ABSENT or store.blobs.size(file.digest) == file.size for file in named)
    assert store.actions.outline(KEY) == (result.output, frozenset(store.actions.references.headers(result.output)[1:]))
    store.blobs.put(b"content")
    assert store.actions.find(KEY) == Found(result, True)
    assert ABSENT not in decode((store.root / "ac" / KEY[:2] / KEY[2:]).read_bytes())


def test_a_result_whose_bytes_were_lost_is_known_as_long_as_its_headers_are_there(
    store: Store, result: ActionResult
) -> None:
    headers = {*store.actions.references.headers(result.output)}
    for key, _ in list(store.blobs.all()):
        store.actions.put(KEY, result)
        data = store.blobs.get(key)
        store.blobs.path(key).unlink()
        assert store.actions.find(KEY) == (None if key in headers else Found(result, False))
        store.blobs.put(data)
        assert store.actions.find(KEY) == Found(result, True)


def test_a_header_that_is_not_there_cannot_be_noted(store: Store, result: ActionResult) -> None:
    for missing in (*store.actions.references.headers(result.output), result.key_document):
        data = store.blobs.get(missing)
        store.blobs.path(missing).unlink()
        with pytest.raises(MissingBlob):
            store.actions.put_bare(KEY, result)
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


def test_the_message_is_byte_for_byte_the_protocol() -> None:
    """Made by hand from remote_execution.proto: ActionResult 2, OutputFile 1, 2, 5, Digest 1, 2."""
    name = "a" * 64
    (found,) = decode(bytes.fromhex("124b" + "0a036c6f67" + "1244" + "0a40" + "61" * 64 + "1005"))
    assert found == OutputFile("log", name, 5)
    assert encode([found]).hex() == "124b" + "0a036c6f67" + "1244" + "0a40" + "61" * 64 + "1005"
    large = OutputFile("log", digest.of_bytes(b"x" * 200), 200, b"x" * 200)
    assert encode([large]).hex()[-2 * 203 :] == "2ac801" + "78" * 200
    assert decode(encode([large, found])) == [large, found]


def test_fields_of_others_are_passed_over() -> None:
    ours = encode([OutputFile("log", "a" * 64, 5)])
    stdout = b"\x2a\x02hi"  # stdout_raw
    metadata = b"\x4a\x03\x0a\x01w"  # execution_metadata
    fixed = b"\x79" + b"\0" * 8 + b"\x7d" + b"\0" * 4
    exit_zero = b"\x20\x00"
    assert decode(stdout + metadata + fixed + exit_zero + ours) == decode(ours)


@pytest.mark.parametrize(
    "data",
    [b"", b"\x12", b"\x12\x05ab", b"\xff" * 20, b"\x20\x01" + encode([OutputFile("log", "a" * 64, 5)]), b"\x13\x01"],
)
def test_what_is_not_a_result_is_refused(store: Store, data: bytes) -> None:
    with pytest.raises((ValueError, IndexError, KeyError)):
        decode(data)
    path = store.root / "ac" / KEY[:2] / KEY[2:]
    path.parent.mkdir(parents=True)
    path.write_bytes(data)
    assert store.actions.get(KEY) is None


def test_every_flipped_bit_is_a_miss_or_harmless(store: Store, result: ActionResult) -> None:
    store.actions.put(KEY, result)
    path = store.root / "ac" / KEY[:2] / KEY[2:]
    whole, known = path.read_bytes(), {key for key, _ in store.blobs.all()}
    for place in range(len(whole)):
        path.unlink(missing_ok=True)
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 4]) + whole[place + 1 :])
        store.actions.outline(KEY)
        assert store.actions.get(KEY) in (None, result), place
        assert {key for key, _ in store.blobs.all()} == known


def test_every_cut_is_a_miss(store: Store, result: ActionResult) -> None:
    store.actions.put(KEY, result)
    path = store.root / "ac" / KEY[:2] / KEY[2:]
    whole = path.read_bytes()
    for end in range(len(whole)):
        path.unlink(missing_ok=True)
        path.write_bytes(whole[:end])
        # A cut between two files leaves a message of the protocol, which names less than a result needs.
        assert store.actions.outline(KEY) is None, end
        assert store.actions.get(KEY) is None, end
