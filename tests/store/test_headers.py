"""Headers read without types agree with those that the artifact types write and read."""

from __future__ import annotations

import json
from typing import Annotated

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build import digest
from dextera_build.artifacts.base import Array, Artifact, Collection, File, Folder, Value
from dextera_build.errors import RuleError, StoreError
from dextera_build.store import headers


class Size(Value):
    """Inline."""

    width: int
    names: tuple[str, ...]


class Inner(Artifact):
    """One array."""

    points: Annotated[np.ndarray, Array("N 3", "float32")]


class Outer(Artifact):
    """Every kind of value that a header can hold."""

    first: Inner
    items: dict[str, Inner]
    pair: tuple[Inner, Inner]
    absent: Inner | None
    raw: bytes
    size: Size
    scale: float
    notes: dict[str, str]


class Memory(dict[str, bytes]):
    """Digest -> bytes."""

    def put(self, data: bytes) -> str:
        key = digest.of_bytes(data)
        self[key] = data
        return key


def inner(value: float) -> Inner:
    return Inner(points=np.full((2, 3), value, np.float32))


@pytest.fixture
def memory() -> Memory:
    return Memory()


@pytest.fixture
def outer(memory: Memory) -> str:
    return Outer(
        first=inner(1),
        items={"mug": inner(2), "box": inner(3)},
        pair=(inner(4), inner(5)),
        absent=None,
        raw=b"raw",
        size=Size(width=1, names=("a", "b")),
        scale=1.5,
        notes={"$ref": "not a reference"},
    ).encode(memory.put)


@pytest.mark.parametrize("label", ["../evil", "a/../../evil", "/etc/passwd", "..", "a/..", "a\0b"])
def test_a_label_that_leads_out_of_its_folder_is_refused(label):
    raw = json.dumps({"artifact": "Folder", "fields": {"files": {"$map": {label: {"$bytes": ["ab" * 32, 1]}}}}})
    with pytest.raises(StoreError, match="leads out of the folder") as caught:
        headers.closure(raw.encode())
    assert caught.value.code == "DXB-S219"


@pytest.mark.parametrize("label", ["a..b", "..a", "a/b..", "...", "a/.b", "x[1]"])
def test_other_labels_are_names(label):
    raw = json.dumps({"artifact": "Folder", "fields": {"files": {"$map": {label: {"$bytes": ["ab" * 32, 1]}}}}})
    assert headers.closure(raw.encode()) == ([], ["ab" * 32])


def test_the_closure_is_all_that_was_put(memory: Memory, outer: str) -> None:
    refs, blobs = headers.closure(memory[outer])
    assert len(refs) == 5
    assert digest.of_bytes(b"raw") in blobs
    assert len(blobs) == 1
    reached = {outer, *refs, *blobs}
    for ref in refs:
        more, data = headers.closure(memory[ref])
        assert more == []
        reached.update(data)
    assert reached == set(memory)


def test_fields_and_keys_of_maps_are_followed(memory: Memory, outer: str) -> None:
    read = memory.__getitem__
    assert headers.project(read, outer, ()) == outer
    first = headers.project(read, outer, ("first",))
    assert Inner.decode(first, read).points[0, 0] == 1
    mug = headers.project(read, outer, ("items", "mug"))
    assert Inner.decode(mug, read).points[0, 0] == 2


@pytest.mark.parametrize(
    ("fields", "message", "hint"),
    [
        (("frist",), "`frist` is not a field of tests.Outer", "did you mean `first`?"),
        (("items", "mgu"), "`mgu` is not in `items` of tests.Outer", "did you mean `mug`?"),
        (("first", "colour"), "`colour` is not a field of tests.Inner", None),
        (("scale",), "`scale`, a field of tests.Outer, is not an artifact", None),
        (("items",), "`items`, a field of tests.Outer, is not an artifact", None),
        (("absent",), "`absent`, a field of tests.Outer, is not set", None),
        (("first", "points"), "`points`, a field of tests.Inner, is not an artifact", None),
    ],
)
def test_a_wrong_step_says_what_there_is(
    memory: Memory, outer: str, fields: tuple[str, ...], message: str, hint: str | None
) -> None:
    with pytest.raises(RuleError) as caught:
        headers.project(memory.__getitem__, outer, fields)
    assert caught.value.message == message
    assert caught.value.hint == hint
    assert caught.value.facts


def test_a_field_that_is_not_set_may_end_the_way(memory: Memory, outer: str) -> None:
    read = memory.__getitem__
    assert headers.project_set(read, outer, ("absent",)) is None
    assert headers.project_set(read, outer, ("absent", "points")) is None
    assert headers.project_set(read, outer, ("first",)) == headers.project(read, outer, ("first",))
    with pytest.raises(RuleError, match=r"`frist` is not a field of tests\.Outer"):
        headers.project_set(read, outer, ("frist",))


def test_items_are_what_each_opens(memory: Memory, outer: str) -> None:
    found = headers.items(memory.__getitem__, outer)
    assert sorted(found) == ["box", "mug"]
    assert found["mug"] == headers.project(memory.__getitem__, outer, ("items", "mug"))


def test_what_has_no_items_cannot_be_opened(memory: Memory) -> None:
    key = inner(1).encode(memory.put)
    with pytest.raises(RuleError, match=r"`each` cannot open tests\.Inner: it has no field `items`") as caught:
        headers.items(memory.__getitem__, key)
    assert caught.value.facts["fields"] == "points"


def test_a_file_header_is_what_the_type_writes(memory: Memory) -> None:
    key = File(data=b"content").encode(memory.put)
    assert headers.file_header(digest.of_bytes(b"content"), 7) == memory[key]


def test_a_folder_header_is_what_the_type_writes(memory: Memory) -> None:
    files = {"b.txt": b"two", "a/ü.bin": b"\0", "empty": b""}
    key = Folder(files=files).encode(memory.put)
    tree = {name: (digest.of_bytes(data), len(data)) for name, data in reversed(files.items())}
    assert headers.folder_header(tree) == memory[key]


def test_a_collection_header_is_what_the_type_writes(memory: Memory) -> None:
    parts = {"mug": inner(1), "box": inner(2)}
    key = Collection[Inner](items=parts).encode(memory.put)
    digests = {label: part.encode(memory.put) for label, part in reversed(parts.items())}
    assert headers.collection_header(digests) == memory[key]
    assert headers.items(memory.__getitem__, key) == digests


CHARACTERS = st.sampled_from('"\\/\0\n\x1f\x7f\x80\u2028\uffffü\U0001f916') | st.characters(exclude_categories=("Cs",))
TEXTS = st.text(CHARACTERS)
DIGESTS = st.binary(min_size=32, max_size=32).map(bytes.hex)


@given(st.dictionaries(TEXTS, DIGESTS | TEXTS))
def test_a_collection_header_is_spelled_as_all_headers_are(parts: dict[str, str]) -> None:
    content = {label: {"$ref": part} for label, part in parts.items()}
    whole = digest.canonical({"artifact": "Collection", "fields": {"items": {"$map": content}}})
    assert headers.collection_header(parts) == whole


@given(DIGESTS | TEXTS, st.integers(min_value=0))
def test_a_file_header_is_spelled_as_all_headers_are(blob: str, size: int) -> None:
    whole = digest.canonical({"artifact": "File", "fields": {"data": {"$bytes": [blob, size]}}})
    assert headers.file_header(blob, size) == whole
    assert headers.closure(whole) == ([], [blob])


@given(TEXTS, st.characters(categories=("Cs",)), TEXTS)
def test_half_a_character_is_in_no_header(before: str, half: str, behind: str) -> None:
    label = before + half + behind
    for spell in (
        lambda: digest.canonical({label: 0}),
        lambda: headers.collection_header({label: "ab" * 32}),
        lambda: headers.collection_header({"mug": label}),
        lambda: headers.file_header(label, 1),
    ):
        with pytest.raises(UnicodeEncodeError):
            spell()


def test_only_parts_are_proposed_as_parts() -> None:
    fields = {
        "mesh": {"$ref": "0" * 64},
        "scores": {"$map": {"a": {"$value": {"iou": 0.5}}}},
        "names": {"$map": {}},
        "n": 1,
    }
    header = json.dumps({"artifact": "tests.Scored", "fields": fields}).encode()
    with pytest.raises(RuleError) as caught:
        headers.project(lambda digest: header, "1" * 64, ("n",))
    assert caught.value.facts == {"artifacts": "mesh"}
